// SPDX-License-Identifier: Apache-2.0
#include "client/app/label_painter.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "common/base/utf8.h"

namespace cairn {
namespace {

constexpr double kFontScale = 0.5;
constexpr int kPadding = 4;          ///< [px] around a text
constexpr int kAway = 14;            ///< [px] from a place to the box of its text, to the right and up
constexpr int kDot = 4;              ///< [px]
constexpr int kTouch = 12;           ///< [px] around a dot
constexpr size_t kMostLetters = 40;  ///< of a text; the rest is left out

const cv::Scalar kInk(25, 25, 25);
const cv::Scalar kPaper(120, 235, 255);
const cv::Scalar kSelectedPaper(255, 225, 130);
const cv::Scalar kFaint(150, 150, 150);

std::string shown_text(const Label& label) {
  const std::string text = label.kind == LabelKind::kModel ? "model " + label.text : label.text;
  const auto all = letters(text);
  if (all.size() <= kMostLetters) return text;
  const auto rest = static_cast<size_t>(all[kMostLetters - 3].data() - text.data());
  return text.substr(0, rest) + "...";
}

void write(const LabelBox& label, const cv::Scalar& ink, const TextPainter& painter, cv::Mat* area) {
  painter.draw(label.text, {label.box.x + kPadding, label.box.br().y - kPadding - 1}, kFontScale, ink, area);
}

void paint_hidden(const LabelBox& label, const TextPainter& painter, cv::Mat* area) {
  cv::circle(*area, label.anchor, kDot, kFaint, 1, cv::LINE_AA);
  write(label, kFaint, painter, area);
}

void paint_seen(const LabelBox& label, bool selected, const TextPainter& painter, cv::Mat* area) {
  const cv::Scalar& paper = selected ? kSelectedPaper : kPaper;
  const cv::Point corner(std::clamp(label.anchor.x, label.box.x, label.box.br().x - 1),
                         std::clamp(label.anchor.y, label.box.y, label.box.br().y - 1));
  cv::line(*area, label.anchor, corner, kInk, 3, cv::LINE_AA);
  cv::line(*area, label.anchor, corner, paper, 1, cv::LINE_AA);
  cv::circle(*area, label.anchor, kDot + 1, kInk, cv::FILLED, cv::LINE_AA);
  cv::circle(*area, label.anchor, kDot, paper, cv::FILLED, cv::LINE_AA);
  cv::rectangle(*area, label.box, paper, cv::FILLED);
  cv::rectangle(*area, label.box, kInk, selected ? 2 : 1);
  write(label, kInk, painter, area);
}

}  // namespace

std::vector<LabelBox> lay_out_labels(const std::vector<LabelInView>& labels, cv::Size area, int scale,
                                     const TextPainter& painter) {
  std::vector<LabelBox> boxes;
  for (const LabelInView& shown : labels) {
    LabelBox label{shown, {}, {}, shown_text(shown.label)};
    label.anchor = {static_cast<int>(std::lround((shown.pixel.x() + 0.5) * scale - 0.5)),
                    static_cast<int>(std::lround((shown.pixel.y() + 0.5) * scale - 0.5))};
    const cv::Size text = painter.size(label.text, kFontScale);
    const cv::Size box(std::min(text.width + 2 * kPadding, area.width),
                       std::min(text.height + 2 * kPadding + 1, area.height));
    const cv::Point corner(std::clamp(label.anchor.x + kAway, 0, area.width - box.width),
                           std::clamp(label.anchor.y - kAway - box.height, 0, area.height - box.height));
    label.box = {corner, box};
    boxes.push_back(std::move(label));
  }
  return boxes;
}

const LabelBox* find_label(const std::vector<LabelBox>& boxes, cv::Point point) {
  const auto hit = std::find_if(boxes.rbegin(), boxes.rend(), [point](const LabelBox& label) {
    return label.box.contains(point) || cv::norm(label.anchor - point) <= kTouch;
  });
  return hit == boxes.rend() ? nullptr : &*hit;
}

void paint_labels(const std::vector<LabelBox>& boxes, LabelId selected, const TextPainter& painter,
                  cv::Mat* area) {
  for (const LabelBox& label : boxes) {
    if (label.shown.hidden) paint_hidden(label, painter, area);
  }
  for (const LabelBox& label : boxes) {
    if (!label.shown.hidden) paint_seen(label, selected && label.shown.label.id == selected, painter, area);
  }
}

}  // namespace cairn
