// SPDX-License-Identifier: Apache-2.0
#include "client/app/label_view.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace cairn {
namespace {

/// Parts of the image's width.
constexpr double kPointed = 1.0 / 50;       ///< a finger or mouse means a point this near
constexpr double kAround = 1.0 / 25;        ///< points that tell whether a label is hidden
constexpr double kNeighbourhood = 1.0 / 5;  ///< points that tell the surface pointed at

/// A point nearer than a label by this factor stands before it, and not on its surface: across kAround in a
/// view of 60 degrees, a surface differs by less unless it is turned by more than 70 degrees.
constexpr double kBefore = 1.15;
constexpr int kLeastBefore = 2;
constexpr size_t kLeastNeighbours = 3;
constexpr size_t kNeighbours = 12;    ///< and more where these are all to one side
constexpr double kOneSurface = 1.3;   ///< neighbours differ less in distance than by this factor
constexpr double kLeastFacing = 0.1;  ///< cosine of ray and normal below which a plane is seen edge-on

/// The seen points in the image within `radius`, nearest first.
std::vector<PointInView> nearest(std::span<const PointInView> seen, const Eigen::Vector2d& pixel,
                                 double radius) {
  std::vector<PointInView> near;
  std::copy_if(seen.begin(), seen.end(), std::back_inserter(near),
               [&](const PointInView& p) { return (p.pixel - pixel).norm() <= radius; });
  std::sort(near.begin(), near.end(), [&](const PointInView& a, const PointInView& b) {
    return (a.pixel - pixel).squaredNorm() < (b.pixel - pixel).squaredNorm();
  });
  return near;
}

bool may_be_of_one_surface(const PointInView& a, const PointInView& b) {
  const double distances[] = {a.position.norm(), b.position.norm()};
  return distances[0] < kOneSurface * distances[1] && distances[1] < kOneSurface * distances[0];
}

/// The points without strays, which have fewer than two others at about their distance: a map has some wrong
/// points, which would draw a label far behind what is pointed at. Few points are left as they are.
std::vector<PointInView> without_strays(std::vector<PointInView> near) {
  if (near.size() < kLeastNeighbours) return near;
  const std::vector<PointInView> all = near;
  std::erase_if(near, [&](const PointInView& p) {
    const auto like = [&p](const PointInView& other) { return may_be_of_one_surface(p, other); };
    return std::count_if(all.begin(), all.end(), like) < static_cast<ptrdiff_t>(kLeastNeighbours);
  });
  return near;
}

/// The points at about the distance of the one pointed closest to: what lies behind it or before it belongs
/// to another surface.
std::vector<PointInView> on_one_surface(std::vector<PointInView> near) {
  const PointInView closest = near.front();
  std::erase_if(near, [&closest](const PointInView& p) { return !may_be_of_one_surface(closest, p); });
  return near;
}

/// Whether a plane through the points is known at the pixel as well as one point is: the leverage of linear
/// regression. Points all to one side, one behind the other, leave it free to tilt about them.
bool reach(const std::vector<PointInView>& points, const Eigen::Vector2d& pixel) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  for (const PointInView& p : points) {
    const Eigen::Vector3d row(1, p.pixel.x() - pixel.x(), p.pixel.y() - pixel.y());
    normal += row * row.transpose();
  }
  const Eigen::FullPivLU<Eigen::Matrix3d> solver(normal);
  return solver.isInvertible() && solver.inverse()(0, 0) <= 1;
}

/// The nearest points of one surface, as many as tell where it is at the pixel; all there are, if these do
/// not. `near`: the points around, nearest first.
std::vector<PointInView> surface_around(std::span<const PointInView> near, const Eigen::Vector2d& pixel) {
  for (size_t count = kNeighbours;; count += kNeighbours) {
    const auto some = near.first(std::min(count, near.size()));
    std::vector<PointInView> surface = without_strays({some.begin(), some.end()});
    if (!surface.empty()) surface = on_one_surface(std::move(surface));
    if (count >= near.size() || reach(surface, pixel)) return surface;
  }
}

/// The point at which a ray meets the plane that fits the points best (total least squares). Nothing for
/// points on a line, a plane seen edge-on, or a place far from the points.
std::optional<Eigen::Vector3d> meet_plane(const Eigen::Vector3d& ray,
                                          const std::vector<PointInView>& points) {
  if (points.size() < kLeastNeighbours) return std::nullopt;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& p : points) mean += p.position / static_cast<double>(points.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const auto& p : points) scatter += (p.position - mean) * (p.position - mean).transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(scatter);
  constexpr double kFlat = 1e-3;  // of the variance along the points, across them
  if (!(axes.eigenvalues()(1) > kFlat * axes.eigenvalues()(2))) return std::nullopt;
  const Eigen::Vector3d normal = axes.eigenvectors().col(0);
  const double facing = normal.dot(ray);
  if (std::abs(facing) < kLeastFacing) return std::nullopt;
  const double distance = normal.dot(mean) / facing;
  if (distance < mean.norm() / kOneSurface || distance > mean.norm() * kOneSurface) return std::nullopt;
  return Eigen::Vector3d(distance * ray);
}

}  // namespace

std::vector<PointInView> seen_points(std::span<const TrackedPoint> points, const MapSnapshot& map,
                                     const SE3& camera_from_map) {
  std::vector<PointInView> seen;
  for (const TrackedPoint& point : points) {
    const auto slot = point.found ? map.find(point.id) : std::nullopt;
    if (!slot) continue;
    const PointBlock& block = *map.point_blocks[static_cast<size_t>(slot->block)];
    seen.push_back({point.pixel.cast<double>(), camera_from_map * block.position(slot->slot)});
  }
  return seen;
}

std::vector<LabelInView> labels_in_view(const std::vector<Label>& labels, const SE3& camera_from_map,
                                        const Camera& camera, std::span<const PointInView> seen) {
  const double radius = kAround * camera.width();
  std::vector<LabelInView> in_view;
  for (const Label& label : labels) {
    const Eigen::Vector3d place = camera_from_map * label.map_from_label.translation();
    const auto pixel = camera.project(place);
    if (!pixel || !camera.in_image(*pixel)) continue;
    const double distance = place.norm();
    int before = 0;
    int others = 0;
    for (const PointInView& p : seen) {
      if ((p.pixel - *pixel).norm() > radius) continue;
      ++(kBefore * p.position.norm() < distance ? before : others);
    }
    in_view.push_back({label, *pixel, distance, before >= kLeastBefore && before > others});
  }
  std::stable_sort(in_view.begin(), in_view.end(),
                   [](const LabelInView& a, const LabelInView& b) { return a.distance > b.distance; });
  return in_view;
}

std::vector<LabelInView> labels_in_view(const OverlayFrame& frame, const Camera& camera) {
  if (!frame.camera_from_map || !frame.snapshot || !frame.labels) return {};
  return labels_in_view(*frame.labels, *frame.camera_from_map, camera,
                        seen_points(frame.points, *frame.snapshot, *frame.camera_from_map));
}

std::optional<Eigen::Vector3d> pick_place(const Eigen::Vector2d& pixel, const Camera& camera,
                                          std::span<const PointInView> seen) {
  const double width = camera.width();
  const auto surface = surface_around(nearest(seen, pixel, kNeighbourhood * width), pixel);
  if (surface.empty()) return std::nullopt;
  if ((surface.front().pixel - pixel).norm() <= kPointed * width) return surface.front().position;
  const Eigen::Vector3d ray = camera.unproject(pixel);
  if (reach(surface, pixel)) {
    if (auto met = meet_plane(ray, surface)) return met;
  }
  if (surface.size() < kLeastNeighbours) return std::nullopt;
  // No plane to be made out: as far as its neighbours.
  double distance = 0;
  for (const auto& p : surface) distance += p.position.norm() / static_cast<double>(surface.size());
  return Eigen::Vector3d(distance * ray);
}

}  // namespace cairn
