// SPDX-License-Identifier: Apache-2.0
#include "client/app/viewer/painter.h"

#include <opencv2/imgproc.hpp>

#include "client/app/text_painter.h"

namespace cairn {
namespace {

constexpr double kFontScale = 0.5;
constexpr int kLine = 24;  ///< [px]
constexpr int kMargin = 10;
constexpr double kShade = 0.35;  ///< of the picture's brightness under text

const cv::Scalar kInk(240, 240, 240);
const cv::Scalar kFrame(140, 140, 140);
const cv::Scalar kActive(120, 235, 255);

void shade(cv::Rect area, cv::Mat* picture) {
  cv::Mat part = (*picture)(area & cv::Rect({0, 0}, picture->size()));
  part *= kShade;
}

void paint_entry(const TextEntry& entry, const TextPainter& painter, cv::Mat* picture) {
  const auto keys = lay_out_keyboard(picture->size(), entry.shifted());
  const int top = keys.front().place.y - kLine - kMargin;
  shade({0, top, picture->cols, picture->rows - top}, picture);
  painter.draw("label: " + entry.text() + "_", {kMargin, top + kLine}, kFontScale, kActive, picture);
  for (const DrawnKey& key : keys) {
    const bool is_active = key.stroke.key == EntryKey::kShift && entry.shifted();
    const cv::Scalar& ink = is_active ? kActive : kInk;
    cv::rectangle(*picture, key.place, kFrame, 1);
    const cv::Size text = painter.size(key.cap, kFontScale);
    painter.draw(key.cap,
                 {key.place.x + (key.place.width - text.width) / 2,
                  key.place.y + (key.place.height + text.height) / 2},
                 kFontScale, ink, picture);
  }
}

void paint_help(const TextPainter& painter, cv::Mat* picture) {
  const auto lines = ViewerControls::help();
  shade({0, 0, picture->cols, 2 * kMargin + kLine * static_cast<int>(lines.size())}, picture);
  int y = kMargin;
  for (const std::string& line : lines) painter.draw(line, {kMargin, y += kLine}, kFontScale, kInk, picture);
}

}  // namespace

void paint_controls(const ViewerControls& controls, MonotonicTime now, const TextPainter& painter,
                    cv::Mat* picture) {
  std::string word = controls.message(now);
  if (controls.frozen()) word = word.empty() ? "frozen: f goes on" : "frozen  " + word;
  if (controls.help_shown()) {
    paint_help(painter, picture);
  } else if (!word.empty()) {
    shade({0, 0, picture->cols, kLine + kMargin}, picture);
    painter.draw(word, {kMargin, kLine}, kFontScale, kActive, picture);
  }
  if (const TextEntry* entry = controls.entry()) paint_entry(*entry, painter, picture);
}

}  // namespace cairn
