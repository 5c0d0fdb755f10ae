// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

#include "client/app/text_painter.h"
#include "client/app/viewer/controls.h"

namespace cairn {

/// Draws what the window shows beyond the overlay: the line being typed with its keyboard, the help, a word.
void paint_controls(const ViewerControls& controls, MonotonicTime now, const TextPainter& painter,
                    cv::Mat* picture);

}  // namespace cairn
