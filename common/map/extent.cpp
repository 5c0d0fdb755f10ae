// SPDX-License-Identifier: Apache-2.0
#include "common/map/extent.h"

#include <fmt/format.h>

#include <cmath>

namespace cairn {
namespace {

std::string describe(const Eigen::Vector3d& place) {
  return fmt::format("{:.2f} {:.2f} {:.2f}", place.x(), place.y(), place.z());
}

bool holds(const Box& box, const Eigen::Vector3d& place) {
  return (place.array() >= box.min.array()).all() && (place.array() <= box.max.array()).all();
}

bool holds(const Sphere& sphere, const Eigen::Vector3d& place) {
  return (place - sphere.center).squaredNorm() <= sphere.radius * sphere.radius;
}

Status check_shape(const Box& box) {
  if (!box.min.allFinite() || !box.max.allFinite())
    return fail(ErrorCode::kUsage, "a corner of the box is not finite");
  if (!(box.min.array() < box.max.array()).all()) {
    return fail(ErrorCode::kUsage,
                "the box " + describe(box.min) + " to " + describe(box.max) +
                    " has no inside: the first corner must be below the second in x, y and z");
  }
  return {};
}

Status check_shape(const Sphere& sphere) {
  if (!sphere.center.allFinite() || !std::isfinite(sphere.radius))
    return fail(ErrorCode::kUsage, "the sphere is not finite");
  if (!(sphere.radius > 0)) return fail(ErrorCode::kUsage, "the radius of the sphere is not positive");
  return {};
}

}  // namespace

bool contains(const Extent& extent, const Eigen::Vector3d& place) {
  return std::visit([&](const auto& shape) { return holds(shape, place); }, extent);
}

Status check(const Extent& extent) {
  return std::visit([](const auto& shape) { return check_shape(shape); }, extent);
}

std::string describe(const Extent& extent) {
  if (const Box* box = std::get_if<Box>(&extent))
    return "box " + describe(box->min) + " to " + describe(box->max);
  const auto& sphere = std::get<Sphere>(extent);
  return fmt::format("{:.2f} around {}", sphere.radius, describe(sphere.center));
}

std::string outside(const Extent& extent, std::string_view what, const Eigen::Vector3d& place) {
  return std::string(what) + ", at " + describe(place) +
         ", is outside of where this client may let the map grow, " + describe(extent);
}

Box with_margin(Box bounds, double margin) {
  bounds.min.array() -= margin;
  bounds.max.array() += margin;
  return bounds;
}

}  // namespace cairn
