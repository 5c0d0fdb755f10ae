// SPDX-License-Identifier: Apache-2.0
#include "client/app/eval/plot.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "client/app/text_painter.h"
#include "common/base/stream_writer.h"

namespace cairn {
namespace {

constexpr int kWidth = 1600;
constexpr int kHeight = 760;
constexpr int kOversampling =
    2;  ///< lines and letters are drawn larger and averaged down: OpenCV's own are rough

const cv::Scalar kInk(40, 40, 40);
const cv::Scalar kGrid(225, 225, 225);
const cv::Scalar kTruth(150, 150, 150);
const std::array<cv::Scalar, 5> kEstimates = {cv::Scalar(190, 100, 20), cv::Scalar(40, 120, 230),
                                              cv::Scalar(60, 150, 60), cv::Scalar(170, 60, 150),
                                              cv::Scalar(50, 50, 200)};

struct Range {
  double low = 0;
  double high = 1;
  [[nodiscard]] double size() const { return high - low; }
};

/// Plain drawing in pixels of the finished image.
class Canvas {
 public:
  Canvas() : pixels_(kHeight * kOversampling, kWidth * kOversampling, CV_8UC3, cv::Scalar(255, 255, 255)) {}

  void line(cv::Point2d a, cv::Point2d b, const cv::Scalar& color, double width = 1) {
    constexpr int kShift = 4;
    constexpr double kFactor = kOversampling * (1 << kShift);
    cv::line(pixels_, cv::Point(a * kFactor), cv::Point(b * kFactor), color,
             std::max(1, static_cast<int>(std::lround(width * kOversampling))), cv::LINE_AA, kShift);
  }
  /// `align_x`: 0 begins at, 0.5 is centred at, 1 ends at `at`; the text's middle line is at at.y.
  void text(const std::string& text, cv::Point2d at, double align_x, double size = 0.5,
            const cv::Scalar& color = kInk) {
    const cv::Size extent = text_size(text, size);
    const cv::Point origin(static_cast<int>(at.x * kOversampling - align_x * extent.width),
                           static_cast<int>(at.y * kOversampling + 0.5 * extent.height));
    painter_.draw(text, origin, size * kOversampling, color, &pixels_, kOversampling);
  }
  [[nodiscard]] double text_width(const std::string& text, double size = 0.5) const {
    return static_cast<double>(text_size(text, size).width) / kOversampling;
  }
  [[nodiscard]] cv::Mat finished() const {
    cv::Mat small;
    cv::resize(pixels_, small, {kWidth, kHeight}, 0, 0, cv::INTER_AREA);
    return small;
  }

 private:
  [[nodiscard]] cv::Size text_size(const std::string& text, double size) const {
    return painter_.size(text, size * kOversampling, kOversampling);
  }
  TextPainter painter_;
  cv::Mat pixels_;
};

/// 1, 2 or 5 times a power of ten, so that about `count` steps fill the range.
double tick_step(double range, int count) {
  const double raw = std::max(range, 1e-12) / count;
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (raw <= factor * power) return factor * power;
  }
  return 10 * power;
}

std::string format_number(double value, double step) {
  std::array<char, 32> text{};
  const int decimals = std::max(0, static_cast<int>(std::ceil(-std::log10(step) - 1e-9)));
  std::snprintf(text.data(), text.size(), "%.*f", decimals, std::abs(value) < 1e-9 * step ? 0.0 : value);
  return text.data();
}

/// A rectangle with two axes.
class Panel {
 public:
  Panel(Canvas& canvas, cv::Rect2d area, Range x, Range y) : canvas_(canvas), area_(area), x_(x), y_(y) {}

  void draw_axes(const std::string& x_label, const std::string& y_label) {
    const double x_step = tick_step(x_.size(), 6);
    for (double x = std::ceil(x_.low / x_step) * x_step; x <= x_.high + 1e-9 * x_step; x += x_step) {
      canvas_.line(at(x, y_.low), at(x, y_.high), kGrid);
      canvas_.text(format_number(x, x_step), at(x, y_.low) + cv::Point2d(0, 14), 0.5, 0.42);
    }
    const double y_step = tick_step(y_.size(), 6);
    for (double y = std::ceil(y_.low / y_step) * y_step; y <= y_.high + 1e-9 * y_step; y += y_step) {
      canvas_.line(at(x_.low, y), at(x_.high, y), kGrid);
      canvas_.text(format_number(y, y_step), at(x_.low, y) - cv::Point2d(8, 0), 1, 0.42);
    }
    canvas_.line(at(x_.low, y_.low), at(x_.high, y_.low), kInk);
    canvas_.line(at(x_.low, y_.low), at(x_.low, y_.high), kInk);
    canvas_.text(x_label, {area_.x + 0.5 * area_.width, area_.y + area_.height + 38}, 0.5);
    canvas_.text(y_label, {area_.x - 8, area_.y - 16}, 0);
  }
  [[nodiscard]] cv::Point2d at(double x, double y) const {
    return {area_.x + (x - x_.low) / x_.size() * area_.width,
            area_.y + (y_.high - y) / y_.size() * area_.height};
  }
  void line(Eigen::Vector2d a, Eigen::Vector2d b, const cv::Scalar& color, double width) {
    canvas_.line(at(a.x(), a.y()), at(b.x(), b.y()), color, width);
  }
  void draw_cross(const Eigen::Vector2d& p, const cv::Scalar& color) {
    const cv::Point2d center = at(p.x(), p.y());
    for (const cv::Point2d arm : {cv::Point2d(4, 4), cv::Point2d(4, -4)}) {
      canvas_.line(center - arm, center + arm, color, 1.5);
    }
  }

 private:
  Canvas& canvas_;
  cv::Rect2d area_;
  Range x_;
  Range y_;
};

/// Longest pause [s] that a curve runs through: longer ones are losses and stay open.
double longest_bridge(const std::vector<double>& times) {
  std::vector<double> steps;
  for (size_t i = 1; i < times.size(); ++i) steps.push_back(times[i] - times[i - 1]);
  if (steps.empty()) return 0;
  std::nth_element(steps.begin(), steps.begin() + static_cast<ptrdiff_t>(steps.size() / 2), steps.end());
  return 5 * steps[steps.size() / 2];
}

void draw_curve(Panel& panel, const std::vector<double>& times, const std::vector<Eigen::Vector2d>& points,
                const cv::Scalar& color, double width) {
  const double bridge = longest_bridge(times);
  for (size_t i = 1; i < points.size(); ++i) {
    if (times[i] - times[i - 1] <= bridge) panel.line(points[i - 1], points[i], color, width);
  }
}

/// The two axes in which the truth spreads most, in x y z order.
std::pair<int, int> plot_axes(const std::vector<StampedPose>& truth) {
  Eigen::AlignedBox3d box;
  for (const auto& pose : truth) box.extend(pose.map_from_camera.translation());
  int least = 0;
  const Eigen::Vector3d sizes = box.sizes();
  sizes.minCoeff(&least);
  return {least == 0 ? 1 : 0, least == 2 ? 1 : 2};
}

struct Path {
  std::vector<double> times;
  std::vector<Eigen::Vector2d> points;
};

Path project(const std::vector<StampedPose>& poses, std::pair<int, int> axes) {
  Path path;
  for (const auto& pose : poses) {
    const auto& p = pose.map_from_camera.translation();
    path.times.push_back(pose.time.seconds());
    path.points.emplace_back(p[axes.first], p[axes.second]);
  }
  return path;
}

/// Ranges of both axes with the same metres per pixel.
std::pair<Range, Range> equal_ranges(const std::vector<Path>& paths, const cv::Rect2d& area) {
  Eigen::AlignedBox2d box;
  for (const auto& path : paths) {
    for (const auto& point : path.points) box.extend(point);
  }
  const double unit = 1.1 * std::max({box.sizes().x() / area.width, box.sizes().y() / area.height, 1e-9});
  const Eigen::Vector2d half = 0.5 * unit * Eigen::Vector2d(area.width, area.height);
  const Eigen::Vector2d center = box.center();
  return {{center.x() - half.x(), center.x() + half.x()}, {center.y() - half.y(), center.y() + half.y()}};
}

void draw_paths(Canvas& canvas, const PlotContent& content) {
  constexpr std::array kAxisNames = {"x", "y", "z"};
  const cv::Rect2d area(90, 90, 640, 600);
  const auto axes = plot_axes(content.truth);
  std::vector<Path> paths = {project(content.truth, axes)};
  for (const auto& estimate : content.estimates) paths.push_back(project(estimate, axes));
  const auto [x, y] = equal_ranges(paths, area);
  Panel panel(canvas, area, x, y);
  panel.draw_axes(std::string(kAxisNames[static_cast<size_t>(axes.first)]) + " [m]",
                  std::string(kAxisNames[static_cast<size_t>(axes.second)]) + " [m]");
  draw_curve(panel, paths[0].times, paths[0].points, kTruth, 4);
  double legend_x = area.x + 70;
  const auto legend = [&](const std::string& name, const cv::Scalar& color, double width) {
    canvas.line({legend_x, area.y - 16}, {legend_x + 26, area.y - 16}, color, width);
    canvas.text(name, {legend_x + 32, area.y - 16}, 0);
    legend_x += 32 + canvas.text_width(name) + 24;
  };
  legend("truth", kTruth, 4);
  for (size_t i = 1; i < paths.size(); ++i) {
    const auto& color = kEstimates[(i - 1) % kEstimates.size()];
    draw_curve(panel, paths[i].times, paths[i].points, color, 1.5);
    if (!paths[i].points.empty()) panel.draw_cross(paths[i].points.front(), color);
    if (i <= kEstimates.size())
      legend(paths.size() == 2 ? "estimate (cross: start)" : "map " + std::to_string(i), color, 1.5);
  }
}

void draw_errors(Canvas& canvas, const PlotContent& content) {
  constexpr double kMetresShown = 0.5;  // larger errors are shown in metres, smaller ones in millimetres
  const cv::Rect2d area(830, 90, 720, 600);
  double largest = content.rmse;
  for (const auto& error : content.errors) largest = std::max(largest, error.value);
  const double factor = largest < kMetresShown ? 1000 : 1;
  const std::string unit = factor > 1 ? "mm" : "m";
  const Timestamp start = content.errors.front().time;
  const double duration = seconds_between(content.errors.back().time, start);
  Panel panel(canvas, area, {0, std::max(duration, 1e-3)}, {0, std::max(1.1 * factor * largest, 1e-9)});
  panel.draw_axes("time [s]", content.error_name + " [" + unit + "]");
  Path path;
  for (const auto& error : content.errors) {
    path.times.push_back(seconds_between(error.time, start));
    path.points.emplace_back(path.times.back(), factor * error.value);
  }
  draw_curve(panel, path.times, path.points, kEstimates[0], 1.2);
  const double rmse = factor * content.rmse;
  panel.line({0, rmse}, {std::max(duration, 1e-3), rmse}, kEstimates[1], 1.2);
  canvas.text("RMSE " + format_number(rmse, std::max(rmse, 1e-9) / 100) + " " + unit,
              {area.x + area.width, area.y - 16}, 1, 0.5, kEstimates[1]);
}

}  // namespace

Status write_plot(const std::filesystem::path& path, const PlotContent& content) {
  Canvas canvas;
  canvas.text(content.title, {kWidth / 2.0, 34}, 0.5, 0.65);
  draw_paths(canvas, content);
  draw_errors(canvas, content);
  std::vector<uint8_t> bytes;
  try {
    cv::imencode(path.extension().string(), canvas.finished(), bytes);
  } catch (const cv::Exception&) {
    return fail(ErrorCode::kUsage, path.string() + ": not a name for an image; end it in .png");
  }
  return write_stream(path, {bytes.begin(), bytes.end()});
}

}  // namespace cairn
