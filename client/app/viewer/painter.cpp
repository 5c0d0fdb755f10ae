// SPDX-License-Identifier: Apache-2.0
#include "client/app/viewer/painter.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "client/app/text_painter.h"

namespace cairn {
namespace {

constexpr double kFontScale = 0.5;
constexpr int kLine = 24;  ///< [px]
constexpr int kMargin = 10;
constexpr double kShade = 0.35;  ///< of the image's brightness under text

constexpr int kInset = 4;  ///< of a side of the image: that of this camera beside another's

const cv::Scalar kEmpty(30, 30, 30);
const cv::Scalar kWarning(60, 60, 255);
const cv::Scalar kInk(240, 240, 240);
const cv::Scalar kFrame(140, 140, 140);
const cv::Scalar kActive(120, 235, 255);

void shade(cv::Rect area, cv::Mat* image) {
  cv::Mat part = (*image)(area & cv::Rect({0, 0}, image->size()));
  part *= kShade;
}

void paint_entry(const TextEntry& entry, bool has_rig, const TextPainter& painter, cv::Mat* image) {
  const auto keys = lay_out_keyboard(image->size(), entry.shifted());
  const int top = keys.front().place.y - kLine - kMargin;
  shade({0, top, image->cols, image->rows - top}, image);
  painter.draw("label: " + entry.text() + "_" + (has_rig ? "   (F12 stops the rig)" : ""),
               {kMargin, top + kLine}, kFontScale, kActive, image);
  for (const DrawnKey& key : keys) {
    const bool is_active = key.stroke.key == EntryKey::kShift && entry.shifted();
    const cv::Scalar& ink = is_active ? kActive : kInk;
    cv::rectangle(*image, key.place, kFrame, 1);
    const cv::Size text = painter.size(key.cap, kFontScale);
    painter.draw(key.cap,
                 {key.place.x + (key.place.width - text.width) / 2,
                  key.place.y + (key.place.height + text.height) / 2},
                 kFontScale, ink, image);
  }
}

void paint_help(const TextPainter& painter, cv::Mat* image) {
  const auto lines = ViewerControls::help();
  shade({0, 0, image->cols, 2 * kMargin + kLine * static_cast<int>(lines.size())}, image);
  int y = kMargin;
  for (const std::string& line : lines) painter.draw(line, {kMargin, y += kLine}, kFontScale, kInk, image);
}

/// The largest rectangle with the shape of the image that fits into the area, in its middle.
cv::Rect fitted(cv::Size pixels, cv::Rect area) {
  const double scale = std::min(static_cast<double>(area.width) / pixels.width,
                                static_cast<double>(area.height) / pixels.height);
  const cv::Size size(std::max(1, static_cast<int>(scale * pixels.width)),
                      std::max(1, static_cast<int>(scale * pixels.height)));
  return {area.x + (area.width - size.width) / 2, area.y + (area.height - size.height) / 2, size.width,
          size.height};
}

}  // namespace

void paint_other(const OtherView& view, cv::Rect area, const TextPainter& painter, cv::Mat* image) {
  cv::Mat own;
  cv::resize((*image)(area), own, area.size() / kInset, 0, 0, cv::INTER_AREA);
  (*image)(area).setTo(kEmpty);
  if (!view.pixels.empty()) {
    cv::Mat other;
    cv::resize(view.pixels, other, fitted(view.pixels.size(), area).size());
    if (is_stale(view) || !view.is_there) {
      cv::Mat grey;
      cv::cvtColor(other, grey, cv::COLOR_BGR2GRAY);
      cv::cvtColor(grey * kShade, other, cv::COLOR_GRAY2BGR);
    }
    other.copyTo((*image)(fitted(view.pixels.size(), area)));
  }
  const cv::Rect corner(area.br() - cv::Point(own.cols, own.rows), own.size());
  own.copyTo((*image)(corner));
  cv::rectangle(*image, corner, kFrame, 1);
  const int bottom = area.br().y;
  shade({area.x, bottom - kLine - kMargin, area.width - own.cols, kLine + kMargin}, image);
  painter.draw(describe(view), {area.x + kMargin, bottom - kMargin}, kFontScale,
               is_stale(view) || !view.is_there ? kWarning : kInk, image);
}

void paint_controls(const ViewerControls& controls, MonotonicTime now, const TextPainter& painter,
                    cv::Mat* image) {
  std::string word = controls.message(now);
  if (controls.frozen()) word = word.empty() ? "frozen: f goes on" : "frozen  " + word;
  if (controls.help_shown()) {
    paint_help(painter, image);
  } else if (!word.empty()) {
    shade({0, 0, image->cols, kLine + kMargin}, image);
    painter.draw(word, {kMargin, kLine}, kFontScale, kActive, image);
  }
  if (const TextEntry* entry = controls.entry()) paint_entry(*entry, controls.has_rig(), painter, image);
}

}  // namespace cairn
