// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/appearance.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "common/geometry/depth_order.h"
#include "common/image/patch.h"

namespace cairn {
namespace {

/// A point this many times as deep as its neighbours is behind them. Of a plane turned by 50 degrees the far
/// points of a neighbourhood go, too; the others speak for them.
constexpr float kBehind = 1.15F;

constexpr int kWindow = 2;    ///< [px of level 3] on each side: 40 px of the picture
constexpr double kNoise = 3;  ///< [grey levels] that contrast must exceed to count

/// What a small image shows at a pixel: its grey level, and how much brighter that is than what lies around
/// it, in units of the contrast there.
struct Brightness {
  double grey = 0;
  double local = 0;
};

std::optional<Brightness> brightness_at(const GrayImage& small, const Eigen::Vector2f& pixel) {
  constexpr int kLevel = kPyramidLevels - 1;
  const float x = to_level(pixel.x(), kLevel);
  const float y = to_level(pixel.y(), kLevel);
  if (!(x >= 0 && y >= 0 && x < static_cast<float>(small.width() - 1) &&
        y < static_cast<float>(small.height() - 1)))
    return std::nullopt;
  const auto column = static_cast<int>(std::lround(x));
  const auto row = static_cast<int>(std::lround(y));
  double n = 0;
  double sum = 0;
  double squares = 0;
  for (int v = std::max(0, row - kWindow); v <= std::min(small.height() - 1, row + kWindow); ++v) {
    for (int u = std::max(0, column - kWindow); u <= std::min(small.width() - 1, column + kWindow); ++u) {
      const double grey = small.row(v)[u];
      n += 1;
      sum += grey;
      squares += grey * grey;
    }
  }
  const double mean = sum / n;
  const double deviation = std::sqrt(std::max(0.0, squares / n - mean * mean));
  const auto grey = static_cast<double>(sample_bilinear(small, x, y));
  return Brightness{grey, (grey - mean) / (deviation + kNoise)};
}

/// Pearson's, of pairs.
class Correlation {
 public:
  void add(double x, double y) {
    n_ += 1;
    x_ += x;
    y_ += y;
    xx_ += x * x;
    yy_ += y * y;
    xy_ += x * y;
  }
  [[nodiscard]] double value() const {
    const double variances = (n_ * xx_ - x_ * x_) * (n_ * yy_ - y_ * y_);
    return variances > 0 ? (n_ * xy_ - x_ * y_) / std::sqrt(variances) : -1;
  }

 private:
  double n_ = 0;
  double x_ = 0;
  double y_ = 0;
  double xx_ = 0;
  double yy_ = 0;
  double xy_ = 0;
};

}  // namespace

double alikeness(const PlaceView& view, const Camera& camera, std::span<const ProjectedPoint> points) {
  DepthOrder order(camera.width(), camera.height());
  for (const ProjectedPoint& p : points) order.add(p.pixel.cast<float>(), static_cast<float>(p.depth));
  Correlation grey;
  Correlation local;
  for (const ProjectedPoint& p : points) {
    if (order.is_hidden(p.pixel.cast<float>(), static_cast<float>(p.depth), kBehind)) continue;
    const auto there = brightness_at(p.keyframe->small, p.keyframe->points[p.index].pixel);
    const auto here = brightness_at(view.small, p.pixel.cast<float>());
    if (!there || !here) continue;
    grey.add(there->grey, here->grey);
    local.add(there->local, here->local);
  }
  return 0.5 * (grey.value() + local.value());
}

}  // namespace cairn
