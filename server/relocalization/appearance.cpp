// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/appearance.h"

#include <algorithm>
#include <cmath>

#include "common/geometry/depth_order.h"
#include "server/relocalization/brightness.h"

namespace cairn {
namespace {

/// A point this many times as deep as its neighbours is behind them. Of a plane turned by 50 degrees the far
/// points of a neighbourhood go, too; the others speak for them.
constexpr float kBehind = 1.15F;

/// Pearson's, of pairs.
class Correlation {
 public:
  void add(double x, double y, double weight) {
    n_ += weight;
    x_ += weight * x;
    y_ += weight * y;
    xx_ += weight * x * x;
    yy_ += weight * y * y;
    xy_ += weight * x * y;
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

double alikeness(const PlaceView& view, const Camera& camera, const ProjectedPoints& projected) {
  DepthOrder order(camera.width(), camera.height());
  for (const ProjectedPoint& p : projected.points) {
    for (const KeyframeSighting& s : projected.sightings_of(p)) {
      for (uint8_t i = 0; i < s.sighting->descriptions; ++i)
        order.add(p.pixel.cast<float>(), static_cast<float>(p.depth));
    }
  }
  Correlation correlation;
  for (const ProjectedPoint& p : projected.points) {
    const Eigen::Vector2f pixel = p.pixel.cast<float>();
    if (order.is_hidden(pixel, static_cast<float>(p.depth), kBehind)) continue;
    const auto here = local_brightness(view.small, pixel);
    if (!here) continue;
    for (const KeyframeSighting& s : projected.sightings_of(p)) {
      const auto& there = s.sighting->brightness;
      if (there)
        correlation.add(static_cast<double>(*there), static_cast<double>(*here), s.sighting->descriptions);
    }
  }
  return correlation.value();
}

}  // namespace cairn
