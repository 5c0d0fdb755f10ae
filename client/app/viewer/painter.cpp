// SPDX-License-Identifier: Apache-2.0
#include "client/app/viewer/painter.h"

#include <opencv2/imgproc.hpp>

#include "client/app/label_painter.h"

namespace cairn {
namespace {

constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
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

void write(const std::string& text, cv::Point baseline, const cv::Scalar& ink, cv::Mat* picture) {
  cv::putText(*picture, printable(text), baseline, kFont, kFontScale, ink, 1, cv::LINE_AA);
}

void paint_entry(const TextEntry& entry, cv::Mat* picture) {
  const auto keys = lay_out_keyboard(picture->size(), entry.shifted());
  const int top = keys.front().place.y - kLine - kMargin;
  shade({0, top, picture->cols, picture->rows - top}, picture);
  write("label: " + entry.text() + "_", {kMargin, top + kLine}, kActive, picture);
  for (const DrawnKey& key : keys) {
    const bool is_active = key.stroke.key == EntryKey::kShift && entry.shifted();
    const cv::Scalar& ink = is_active ? kActive : kInk;
    cv::rectangle(*picture, key.place, kFrame, 1);
    int baseline = 0;
    const cv::Size text = cv::getTextSize(key.cap, kFont, kFontScale, 1, &baseline);
    write(key.cap,
          {key.place.x + (key.place.width - text.width) / 2,
           key.place.y + (key.place.height + text.height) / 2},
          ink, picture);
  }
}

void paint_help(cv::Mat* picture) {
  const auto lines = ViewerControls::help();
  shade({0, 0, picture->cols, 2 * kMargin + kLine * static_cast<int>(lines.size())}, picture);
  int y = kMargin;
  for (const std::string& line : lines) write(line, {kMargin, y += kLine}, kInk, picture);
}

}  // namespace

void paint_controls(const ViewerControls& controls, MonotonicTime now, cv::Mat* picture) {
  std::string word = controls.message(now);
  if (controls.frozen()) word = word.empty() ? "frozen: f goes on" : "frozen  " + word;
  if (controls.help_shown()) {
    paint_help(picture);
  } else if (!word.empty()) {
    shade({0, 0, picture->cols, kLine + kMargin}, picture);
    write(word, {kMargin, kLine}, kActive, picture);
  }
  if (const TextEntry* entry = controls.entry()) paint_entry(*entry, picture);
}

}  // namespace cairn
