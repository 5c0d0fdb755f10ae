// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/third_view.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/geometry/pose.h"
#include "common/geometry/triangulation.h"

namespace cairn {
namespace {

constexpr double kCutoff = 9.21;  ///< 99 % of chi^2 with two degrees of freedom
/// The best motion is decided for when the second costs this many times as much. The noise of trails differs
/// by ten between sharp and compressed pictures, so the residuals themselves say how large it is; what
/// calibration leaves unexplained is in both.
constexpr double kClearRatio = 1.3;
constexpr double kLeastNoise = 0.05;  ///< [px] below which residuals are taken for chance

using Points = std::vector<std::optional<Eigen::Vector3d>>;

Points triangulate_all(const Camera& camera, std::span<const PixelMatch> matches, const SE3& b_from_a) {
  Points points;
  points.reserve(matches.size());
  for (const PixelMatch& m : matches) {
    points.emplace_back();
    if (!m.a.allFinite() || !m.b.allFinite()) continue;
    if (const auto point = triangulate(b_from_a, camera.unproject(m.a), camera.unproject(m.b)))
      points.back() = *point;
  }
  return points;
}

double cost_in_view(const Camera& camera, const Points& points, std::span<const size_t> common,
                    const SE3& start, const ThirdView& view, double sigma) {
  std::vector<PointObservation> observations;
  observations.reserve(common.size());
  for (const size_t i : common) observations.push_back({*points[i], view.pixels[i], sigma});
  const double worst = kCutoff * static_cast<double>(common.size());
  const auto pose = optimize_pose(camera, start, observations);
  if (!pose) return worst;
  double cost = 0;
  for (const PointObservation& o : observations) {
    const auto pixel = camera.project(pose->camera_from_map * o.point_in_map);
    cost += pixel ? std::min(kCutoff, (*pixel - o.pixel).squaredNorm() / (sigma * sigma)) : kCutoff;
  }
  return cost;
}

}  // namespace

MotionChoice choose_motion(const Camera& camera, std::span<const PixelMatch> matches,
                           std::span<const SE3> b_from_a, std::span<const ThirdView> views, double sigma) {
  std::vector<Points> points;
  points.reserve(b_from_a.size());
  for (const SE3& motion : b_from_a) points.push_back(triangulate_all(camera, matches, motion));
  std::vector<size_t> common;
  for (size_t i = 0; i < matches.size(); ++i) {
    const bool everywhere =
        std::all_of(points.begin(), points.end(), [i](const Points& p) { return p[i].has_value(); }) &&
        std::all_of(views.begin(), views.end(), [i](const ThirdView& v) { return v.pixels[i].allFinite(); });
    if (everywhere) common.push_back(i);
  }
  MotionChoice choice;
  choice.residuals = common.size() * views.size();
  for (size_t m = 0; m < b_from_a.size(); ++m) {
    double cost = 0;
    for (const ThirdView& view : views) {
      const SE3 start = SE3::exp(view.way * b_from_a[m].log());
      cost += cost_in_view(camera, points[m], common, start, view, sigma);
    }
    choice.cost.push_back(cost);
  }
  choice.best =
      static_cast<size_t>(std::min_element(choice.cost.begin(), choice.cost.end()) - choice.cost.begin());
  double second = std::numeric_limits<double>::infinity();
  for (size_t m = 0; m < choice.cost.size(); ++m) {
    if (m != choice.best) second = std::min(second, choice.cost[m]);
  }
  const double floor = 2 * std::pow(kLeastNoise / sigma, 2) * static_cast<double>(choice.residuals);
  choice.decided = choice.residuals > 0 && second > kClearRatio * std::max(choice.cost[choice.best], floor);
  return choice;
}

}  // namespace cairn
