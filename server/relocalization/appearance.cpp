// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/appearance.h"

#include <cmath>
#include <optional>

#include "common/image/patch.h"

namespace cairn {
namespace {

std::optional<double> grey_at(const GrayImage& small, const Eigen::Vector2f& pixel) {
  constexpr int kLevel = kPyramidLevels - 1;
  const float x = to_level(pixel.x(), kLevel);
  const float y = to_level(pixel.y(), kLevel);
  if (!(x >= 0 && y >= 0 && x < static_cast<float>(small.width() - 1) &&
        y < static_cast<float>(small.height() - 1)))
    return std::nullopt;
  return static_cast<double>(sample_bilinear(small, x, y));
}

}  // namespace

double alikeness(const PlaceView& view, std::span<const ProjectedPoint> points) {
  double n = 0;
  double x = 0;
  double y = 0;
  double xx = 0;
  double yy = 0;
  double xy = 0;
  for (const ProjectedPoint& p : points) {
    const auto there = grey_at(p.keyframe->small, p.keyframe->points[p.index].pixel);
    const auto here = grey_at(view.small, p.pixel.cast<float>());
    if (!there || !here) continue;
    n += 1;
    x += *there;
    y += *here;
    xx += *there * *there;
    yy += *here * *here;
    xy += *there * *here;
  }
  const double variances = (n * xx - x * x) * (n * yy - y * y);
  return variances > 0 ? (n * xy - x * y) / std::sqrt(variances) : -1;
}

}  // namespace cairn
