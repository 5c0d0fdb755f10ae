// SPDX-License-Identifier: Apache-2.0
#include "tests/world/world_builder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "tests/world/patterns.h"

namespace cairn {
namespace {

constexpr int kCylinderSides = 16;
static_assert(kCylinderSides <= kMaxFaceCorners);

}  // namespace

Light light_of(Daytime daytime) {
  if (daytime == Daytime::kMorning) return {};
  return {Eigen::Vector3d(0.62, -0.2, 0.6), 0.34, 0.66, 0.3, Eigen::Vector2d(-0.034, 0.012), true};
}

Eigen::Vector3d Placement::operator*(const Eigen::Vector3d& local) const {
  return base + Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * local;
}

void WorldBuilder::begin(const SE3& body_from_frame, int place, int body) {
  body_from_frame_ = body_from_frame;
  place_ = place;
  body_ = body;
  footprints_.clear();
}

float WorldBuilder::brightness_of(const Eigen::Vector3d& normal, const TextureRegion& region) const {
  const double lit = std::max(0.0, normal.dot(light_.to_source.normalized()));
  return static_cast<float>((light_.ambient + light_.direct * lit) * (1 + light_.warmth * region.warmth));
}

TextureRegion WorldBuilder::add_texture(const Bitmap& picture, double warmth) {
  scenario_.textures.emplace_back(picture);
  return {static_cast<int>(scenario_.textures.size()) - 1, 0,     0, static_cast<double>(picture.width()),
          static_cast<double>(picture.height()),           warmth};
}

TextureRegion WorldBuilder::add_plain(float value) {
  Random random(static_cast<uint64_t>(scenario_.textures.size()), 0x706C61);
  constexpr int kSize = 64;
  Bitmap noise = pink_noise(kSize, kSize, kSize / 2, 4, 0.01F, random);
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) noise.at(x, y) += value;
  }
  return add_texture(noise);
}

void WorldBuilder::add_panel(const Eigen::Vector3d& origin, const Eigen::Vector3d& right,
                             const Eigen::Vector3d& up, const TextureRegion& region) {
  add_cut_out({}, origin, right, up, region);
}

void WorldBuilder::add_cut_out(const std::vector<Eigen::Vector3d>& corners, const Eigen::Vector3d& origin,
                               const Eigen::Vector3d& right, const Eigen::Vector3d& up,
                               const TextureRegion& region) {
  const Eigen::Matrix3d rotation = body_from_frame_.rotation_matrix();
  const Eigen::Vector3d normal = rotation * right.cross(up).normalized();
  // Light falls on moving bodies as where they are at first.
  const Eigen::Matrix3d map_from_body =
      scenario_.bodies[static_cast<size_t>(body_)].map_from_body.rotation_matrix();
  Face face = make_face(rotation * origin + body_from_frame_.translation(), rotation * right, rotation * up,
                        region, brightness_of(map_from_body * normal, region));
  if (!corners.empty()) face.corners.clear();
  for (const Eigen::Vector3d& corner : corners) {
    face.corners.push_back(rotation * corner + body_from_frame_.translation());
  }
  face.place = place_;
  face.body = body_;
  scenario_.faces.push_back(std::move(face));
}

void WorldBuilder::add_footprint(const Placement& at, double half_width, double half_depth) {
  if (std::abs(at.base.z()) < 0.005) {
    footprints_.push_back({at.base.head<2>(), {half_width, half_depth}, at.yaw});
  }
}

void WorldBuilder::add_box(const Placement& at, const Eigen::Vector3d& size, const BoxSides& sides) {
  const double x = size.x() / 2;
  const double y = size.y() / 2;
  const std::array<Eigen::Vector3d, 4> base = {at * Eigen::Vector3d(-x, -y, 0),
                                               at * Eigen::Vector3d(x, -y, 0), at * Eigen::Vector3d(x, y, 0),
                                               at * Eigen::Vector3d(-x, y, 0)};
  const Eigen::Vector3d up(0, 0, size.z());
  for (size_t i = 0; i < 4; ++i) {
    add_panel(base[i], base[(i + 1) % 4] - base[i], up, i == 0 ? sides.front : sides.side);
  }
  add_panel(base[0] + up, base[1] - base[0], base[3] - base[0], sides.top);
  add_footprint(at, x, y);
}

void WorldBuilder::add_cylinder(const Placement& at, double radius, double height, const TextureRegion& label,
                                const TextureRegion& top) {
  const auto rim = [&](int i) {
    const double angle = 2 * std::numbers::pi * i / kCylinderSides;
    return at * Eigen::Vector3d(radius * std::cos(angle), radius * std::sin(angle), 0);
  };
  const Eigen::Vector3d up(0, 0, height);
  for (int i = 0; i < kCylinderSides; ++i) {
    TextureRegion strip = label;
    strip.width /= kCylinderSides;
    strip.x0 += strip.width * i;
    add_panel(rim(i), rim(i + 1) - rim(i), up, strip);
  }
  // The lid is cut from the square about it.
  std::vector<Eigen::Vector3d> lid;
  for (int i = 0; i < kCylinderSides; ++i) lid.push_back(rim(i) + up);
  const Eigen::Vector3d corner = at * Eigen::Vector3d(-radius, -radius, height);
  add_cut_out(lid, corner, at * Eigen::Vector3d(radius, -radius, height) - corner,
              at * Eigen::Vector3d(-radius, radius, height) - corner, top);
  add_footprint(at, radius * 0.85, radius * 0.85);
}

void WorldBuilder::add_cable(const std::vector<Eigen::Vector3d>& points, double thickness,
                             const TextureRegion& material) {
  // The same cross-section all along, square to the chord: every side of every piece is a parallelogram,
  // hence flat.
  const Eigen::Vector3d chord = points.back() - points.front();
  const Eigen::Vector3d aside = chord.cross(Eigen::Vector3d(0.1, 0.2, 1.0)).normalized();
  const Eigen::Vector3d above = aside.cross(chord).normalized();
  const double half = thickness / 2;
  const std::array<Eigen::Vector3d, 4> section = {half * aside, half * above, -half * aside, -half * above};
  for (size_t i = 0; i + 1 < points.size(); ++i) {
    for (size_t side = 0; side < section.size(); ++side) {
      add_panel(points[i] + section[side], points[i + 1] - points[i], section[(side + 1) % 4] - section[side],
                material);
    }
  }
}

void WorldBuilder::add_sheet(const Placement& at, double width, double depth, const TextureRegion& region) {
  const Eigen::Vector3d origin = at * Eigen::Vector3d(-width / 2, -depth / 2, 0);
  add_panel(origin, at * Eigen::Vector3d(width / 2, -depth / 2, 0) - origin,
            at * Eigen::Vector3d(-width / 2, depth / 2, 0) - origin, region);
}

void WorldBuilder::paint_shadows(Bitmap* picture, double width, double depth) const {
  const double per_metre = picture->width() / width;
  const auto pixels = [per_metre](double metres) { return static_cast<float>(metres * per_metre); };
  for (const Footprint& footprint : footprints_) {
    const float x = pixels(footprint.centre.x() + width / 2);
    const float y = pixels(depth / 2 - footprint.centre.y());
    const float half_x = pixels(footprint.half_size.x());
    const float half_y = pixels(footprint.half_size.y());
    const auto angle = static_cast<float>(-footprint.yaw);
    // A soft shadow on the side away from the light and a narrow dark seam under the edge.
    picture->shade_rectangle(x + pixels(light_.shadow.x()), y - pixels(light_.shadow.y()),
                             half_x + pixels(0.00625), half_y + pixels(0.00625), angle, pixels(0.0203),
                             0.35F);
    picture->shade_rectangle(x, y, half_x + pixels(0.0016), half_y + pixels(0.0016), angle, pixels(0.0047),
                             0.5F);
  }
}

}  // namespace cairn
