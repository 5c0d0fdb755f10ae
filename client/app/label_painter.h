// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "client/app/label_view.h"
#include "client/app/text_painter.h"

namespace cairn {

/// A label as it is drawn in an area: a dot at its place, and its text in a box beside.
struct LabelBox {
  LabelInView shown;
  cv::Point anchor;  ///< [px of the area]
  cv::Rect box;      ///< [px of the area]; wholly in it
  std::string text;
};

/// `scale`: pixels of the area per pixel of the camera. Keeps the order.
[[nodiscard]] std::vector<LabelBox> lay_out_labels(const std::vector<LabelInView>& labels, cv::Size area,
                                                   int scale, const TextPainter& painter);
/// The label drawn last whose box or dot is at `point`; nothing: none.
[[nodiscard]] const LabelBox* find_label(const std::vector<LabelBox>& boxes, cv::Point point);
/// Hidden ones are drawn faint. `area`: BGR.
void paint_labels(const std::vector<LabelBox>& boxes, LabelId selected, const TextPainter& painter,
                  cv::Mat* area);

}  // namespace cairn
