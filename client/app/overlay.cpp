// SPDX-License-Identifier: Apache-2.0
#include "client/app/overlay.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "client/app/label_painter.h"
#include "client/app/label_view.h"

namespace cairn {
namespace {

constexpr int kReadableWidth = 640;  ///< [px] below this the image is enlarged
constexpr int kMostEnlarged = 4096;  ///< [px] height to which a narrow image may grow by that
/// [px] of the result: FFmpeg's MJPEG writes beyond its memory for images of 4 x 4044.
constexpr int kLeastWidth = 64;
constexpr int kStatusRow = 22;  ///< [px] height of a status line
constexpr int kStatusRows = 2;
constexpr int kTextMargin = 6;  ///< [px]
constexpr double kFontScale = 0.45;
constexpr double kSmallest = 0.6;  ///< of the font: to this a long line is made to fit, then it is cut
constexpr int kShift = 4;          ///< binary digits after the point of coordinates given to OpenCV
constexpr int kGridHalfCells = 8;
constexpr int kSegmentsPerCell = 2;  ///< straight pieces of a grid line per cell: lens distortion bends it

const cv::Scalar kGridColor(200, 170, 60);
const cv::Scalar kMissedColor(110, 110, 110);
const cv::Scalar kTrailColor(60, 220, 220);
const cv::Scalar kTextColor(235, 235, 235);
const cv::Scalar kMinorTextColor(170, 170, 170);

/// Finest to coarsest pyramid level: red, yellow, green, blue.
const std::array<cv::Scalar, 4> kLevelColors = {cv::Scalar(60, 60, 255), cv::Scalar(40, 230, 255),
                                                cv::Scalar(80, 220, 60), cv::Scalar(255, 140, 60)};
/// x red, y green, z blue.
const std::array<cv::Scalar, 3> kAxisColors = {cv::Scalar(60, 60, 255), cv::Scalar(80, 220, 60),
                                               cv::Scalar(255, 140, 60)};

cv::Scalar state_color(FrameState state) {
  switch (state) {
    case FrameState::kTracking:
      return {80, 220, 60};
    case FrameState::kPoor:
    case FrameState::kRotation:
      return {40, 200, 255};
    case FrameState::kLost:
    case FrameState::kDropped:
      return {60, 60, 255};
    case FrameState::kStarting:
      return {220, 200, 60};
  }
  return kTextColor;
}

/// The largest of 1, 2, 5 times a power of ten that is not above `value`.
double round_step(double value) {
  const double decade = std::pow(10.0, std::floor(std::log10(value)));
  const double mantissa = value / decade;
  return decade * (mantissa >= 5 ? 5 : mantissa >= 2 ? 2 : 1);
}

int scale_of(const Camera& camera) {
  const int readable = (kReadableWidth + camera.width() - 1) / camera.width();
  return std::clamp(kMostEnlarged / camera.height(), 1, readable);
}

}  // namespace

OverlayFrame make_overlay_frame(const FrameReport& report) {
  const auto& result = report.result;
  OverlayFrame frame;
  frame.image = report.frame.image;
  frame.time = report.frame.time;
  frame.number = report.number;
  frame.state = report.state;
  if (is_tracked(report.state) || report.state == FrameState::kRotation)
    frame.camera_from_map = result.camera_from_map;
  frame.map = result.map;
  frame.revision = result.revision;
  if (report.snapshot) {
    frame.map_name = report.snapshot->name;
    frame.map_keyframes = report.snapshot->keyframe_count();
    frame.map_points = report.snapshot->point_count();
  }
  frame.found = result.found;
  frame.attempted = result.attempted;
  frame.mean_depth = result.mean_depth;
  frame.cpu_ms = std::chrono::duration<double, std::milli>(report.cpu).count();
  if (report.snapshot && report.snapshot->map == result.map) {
    frame.snapshot = report.snapshot;
    frame.labels = report.labels;
  }
  frame.camera = report.camera;
  frame.points = result.points;
  frame.trails = result.trails;
  frame.note = result.note;
  frame.server_text = report.status.text;
  frame.rig = report.rig;
  return frame;
}

Overlay::Overlay(CameraPtr camera) : camera_(std::move(camera)), scale_(scale_of(*camera_)) {
  canvas_.create(size(), CV_8UC3);
  camera_area_ = canvas_(cv::Rect(0, 0, camera_->width() * scale_, camera_->height() * scale_));
}

cv::Size Overlay::size() const {
  const int width = camera_->width() * scale_;
  const int height = camera_->height() * scale_ + kStatusRows * kStatusRow;
  return {std::max(kLeastWidth, (width + 1) / 2 * 2), (height + 1) / 2 * 2};  // video codecs want even sides
}

const cv::Mat& Overlay::draw(const OverlayFrame& frame, const OverlayStyle& style) {
  if (frame.camera) camera_ = frame.camera;
  draw_background(frame.image->view());
  draw_trails(frame.trails);
  if (frame.camera_from_map) {
    choose_grid(frame);
    draw_grid(*frame.camera_from_map);
    draw_axes(*frame.camera_from_map);
  }
  if (style.points) draw_points(frame.points);
  draw_labels(frame, style.selected);
  draw_status(frame);
  return canvas_;
}

void Overlay::draw_background(const GrayView& image) {
  // OpenCV has no read-only matrix header; the pixels are only read.
  const cv::Mat gray(image.height, image.width, CV_8UC1, const_cast<uint8_t*>(image.data),
                     static_cast<size_t>(image.stride));
  cv::Mat color;
  cv::cvtColor(gray, color, cv::COLOR_GRAY2BGR);
  cv::resize(color, color, cv::Size(image.width * scale_, image.height * scale_), 0, 0, cv::INTER_LINEAR);
  canvas_.setTo(cv::Scalar(30, 30, 30));
  color(cv::Rect(0, 0, camera_area_.cols, camera_area_.rows)).copyTo(camera_area_);
}

/// Canvas coordinates with kShift binary digits. The centre of pixel 0 lies at (scale - 1) / 2 of the
/// enlarged image.
cv::Point Overlay::to_canvas(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d p = ((pixel.array() + 0.5) * scale_ - 0.5) * (1 << kShift);
  return {static_cast<int>(std::lround(p.x())), static_cast<int>(std::lround(p.y()))};
}

void Overlay::draw_trails(const std::vector<TrailLine>& trails) {
  for (const auto& trail : trails) {
    const auto now = to_canvas(trail.now.cast<double>());
    cv::line(camera_area_, to_canvas(trail.first.cast<double>()), now, kTrailColor, 1, cv::LINE_AA, kShift);
    cv::circle(camera_area_, now, 2 << kShift, kTrailColor, cv::FILLED, cv::LINE_AA, kShift);
  }
}

void Overlay::draw_points(const std::vector<TrackedPoint>& points) {
  for (const auto& point : points) {
    if (!point.pixel.allFinite() || !camera_->in_image(point.pixel.cast<double>())) continue;
    const auto center = to_canvas(point.pixel.cast<double>());
    const size_t level = std::min<size_t>(point.level, kLevelColors.size() - 1);
    if (point.found) {
      cv::circle(camera_area_, center, (2 + static_cast<int>(level)) << kShift, kLevelColors[level], 1,
                 cv::LINE_AA, kShift);
    } else {
      cv::circle(camera_area_, center, 1 << kShift, kMissedColor, cv::FILLED, cv::LINE_AA, kShift);
    }
  }
}

void Overlay::choose_grid(const OverlayFrame& frame) {
  const bool usable = std::isfinite(frame.mean_depth) && frame.mean_depth > 0;
  if (!usable || (grid_step_ > 0 && frame.map == grid_map_)) return;
  grid_map_ = frame.map;
  grid_step_ = round_step(frame.mean_depth / 8);
}

/// A straight line of the map, cut at a plane just in front of the camera and bent as the lens does.
void Overlay::draw_map_line(const SE3& camera_from_map, const Eigen::Vector3d& from,
                            const Eigen::Vector3d& to, const cv::Scalar& color, int thickness) {
  const double near_depth = 0.1 * grid_step_;
  Eigen::Vector3d a = camera_from_map * from;
  Eigen::Vector3d b = camera_from_map * to;
  if (a.z() < near_depth && b.z() < near_depth) return;
  if (a.z() < near_depth) a += (b - a) * ((near_depth - a.z()) / (b.z() - a.z()));
  if (b.z() < near_depth) b += (a - b) * ((near_depth - b.z()) / (a.z() - b.z()));
  const auto pixel_a = camera_->project(a);
  const auto pixel_b = camera_->project(b);
  if (!pixel_a || !pixel_b) return;
  // Pieces far outside say nothing, and their coordinates would overflow OpenCV's.
  const double margin = camera_->width() + camera_->height();
  if (!camera_->in_image(*pixel_a, -margin) || !camera_->in_image(*pixel_b, -margin)) return;
  cv::line(camera_area_, to_canvas(*pixel_a), to_canvas(*pixel_b), color, thickness, cv::LINE_AA, kShift);
}

void Overlay::draw_grid(const SE3& camera_from_map) {
  if (grid_step_ <= 0) return;
  const double piece = grid_step_ / kSegmentsPerCell;
  const int pieces = kGridHalfCells * kSegmentsPerCell;
  for (int line = -kGridHalfCells; line <= kGridHalfCells; ++line) {
    const double across = line * grid_step_;
    for (int i = -pieces; i < pieces; ++i) {
      const double start = i * piece;
      draw_map_line(camera_from_map, {across, start, 0}, {across, start + piece, 0}, kGridColor, 1);
      draw_map_line(camera_from_map, {start, across, 0}, {start + piece, across, 0}, kGridColor, 1);
    }
  }
}

void Overlay::draw_axes(const SE3& camera_from_map) {
  if (grid_step_ <= 0) return;
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d tip = 2 * grid_step_ * Eigen::Vector3d::Unit(axis);
    draw_map_line(camera_from_map, Eigen::Vector3d::Zero(), tip, kAxisColors[static_cast<size_t>(axis)], 2);
  }
}

void Overlay::draw_labels(const OverlayFrame& frame, LabelId selected) {
  paint_labels(lay_out_labels(labels_in_view(frame, *camera_), camera_area_.size(), scale_, painter_),
               selected, painter_, &camera_area_);
}

void Overlay::draw_text(const std::string& text, int row, const cv::Scalar& color) {
  const cv::Point origin(kTextMargin, camera_area_.rows + row * kStatusRow + kStatusRow * 3 / 4);
  const int width = painter_.size(text, kFontScale).width;
  const double fit = static_cast<double>(canvas_.cols - 2 * kTextMargin) / std::max(1, width);
  painter_.draw(text, origin, kFontScale * std::clamp(fit, kSmallest, 1.0), color, &canvas_);
}

void Overlay::draw_status(const OverlayFrame& frame) {
  if (last_time_ && frame.time > *last_time_) {
    const double rate = 1.0 / seconds_between(frame.time, *last_time_);
    frame_rate_ = frame_rate_ > 0 ? std::lerp(frame_rate_, rate, 0.1) : rate;
  }
  last_time_ = frame.time;

  std::string line = fmt::format("{}  #{}", to_string(frame.state), frame.number);
  if (frame.attempted > 0) line += fmt::format("  found {}/{}", frame.found, frame.attempted);
  line += fmt::format("  {:.0f} Hz  {:.1f} ms", frame_rate_, frame.cpu_ms);
  if (!frame.note.empty()) line += "  " + frame.note;
  draw_text(line, 0, state_color(frame.state));

  std::string surroundings;
  if (frame.map_points > 0) {
    surroundings = fmt::format("{} r{}  {} keyframes  {} points  ", frame.map_name, frame.revision.value,
                               frame.map_keyframes, frame.map_points);
  }
  const std::string rig = frame.rig.empty() ? "" : frame.rig + "  ";
  draw_text(rig + surroundings + frame.server_text, 1, kMinorTextColor);
}

}  // namespace cairn
