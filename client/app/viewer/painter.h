// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

#include "client/app/text_painter.h"
#include "client/app/viewer/controls.h"

namespace cairn {

/// Draws the image of another camera over that of this one in `area` of the window's, and this one small in
/// a corner. What is not of now is dark and grey, and said.
void paint_other(const OtherView& view, cv::Rect area, const TextPainter& painter, cv::Mat* image);

/// Draws what the window shows beyond the overlay: the line being typed with its keyboard, the help, a word.
void paint_controls(const ViewerControls& controls, MonotonicTime now, const TextPainter& painter,
                    cv::Mat* image);

}  // namespace cairn
