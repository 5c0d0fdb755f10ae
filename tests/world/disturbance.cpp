// SPDX-License-Identifier: Apache-2.0
#include "tests/world/disturbance.h"

#include <cmath>
#include <numbers>

#include "tests/world/patterns.h"
#include "tests/world/world_builder.h"

namespace cairn {
namespace {

constexpr double kQuiet = 6;         // s at the start
constexpr double kHandDepth = 0.08;  // m

}  // namespace

EventTrain::EventTrain(double per_minute, double duration, uint64_t seed, uint64_t stream)
    : per_minute_(per_minute), duration_(duration), seed_(seed), stream_(stream) {}

std::optional<EventTrain::Moment> EventTrain::at(double seconds) const {
  if (per_minute_ <= 0 || seconds < kQuiet) return std::nullopt;
  const double slot = 60 / per_minute_;
  const auto event = static_cast<uint64_t>((seconds - kQuiet) / slot);
  const double begin = kQuiet + static_cast<double>(event) * slot +
                       Random(seed_, mix_bits(stream_) + event).unit() * (slot - duration_);
  const double part = (seconds - begin) / duration_;
  if (part < 0 || part >= 1) return std::nullopt;
  return Moment{event, part};
}

size_t add_hand(uint64_t seed, Scenario* scenario) {
  const size_t body = scenario->bodies.size();
  scenario->bodies.emplace_back();
  WorldBuilder world(std::move(*scenario), Light{Eigen::Vector3d(0, -0.5, -1), 0.5, 0.5});
  Random random(seed, 0x68616E64);
  Bitmap skin = pink_noise(128, 128, 64, 6, 0.05F, random);
  for (int y = 0; y < skin.height(); ++y) {
    for (int x = 0; x < skin.width(); ++x) skin.at(x, y) += 0.62F;
  }
  const BoxSides flesh = {world.add_texture(skin), world.add_texture(skin), world.add_texture(skin)};
  // Boxes stand on the builder's z: turned so that this points at the camera, fingers to the left.
  const SE3 camera_from_box((Eigen::Matrix3d() << 1, 0, 0, 0, -1, 0, 0, 0, -1).finished(),
                            Eigen::Vector3d::Zero());
  world.begin(camera_from_box, -1, static_cast<int>(body));
  world.add_box({{0.02, 0, -0.03}, 0}, {0.11, 0.10, 0.03}, flesh);
  for (int finger = 0; finger < 4; ++finger) {
    world.add_box({{-0.065, 0.037 - 0.0245 * finger, -0.025}, 0.03 * (finger - 1)}, {0.075, 0.021, 0.02},
                  flesh);
  }
  world.add_box({{-0.005, -0.065, -0.03}, 0.7}, {0.08, 0.024, 0.022}, flesh);
  world.add_box({{0.22, 0, -0.05}, 0}, {0.32, 0.08, 0.06}, flesh);
  *scenario = std::move(world.scenario());
  return body;
}

SE3 camera_from_hand(double part) {
  const double in =
      minimum_jerk(part / 0.35) - minimum_jerk((part - 0.65) / 0.35);  // 0 away, 1 before the lens
  return {so3_exp({0, 0, 0.25 * (1 - in)}),
          Eigen::Vector3d(0.30 * (1 - in) - 0.005, 0.05 * (1 - in), kHandDepth)};
}

SE3 jerk(double part, uint64_t event, uint64_t seed) {
  const double direction = 2 * std::numbers::pi * Random(seed, 0x6A65726B + event).unit();
  const double bump = std::pow(std::sin(std::numbers::pi * part), 4);
  const double angle = 25 * std::numbers::pi / 180 * bump;
  return {so3_exp(angle * Eigen::Vector3d(0.6 * std::sin(direction), std::cos(direction), 0)),
          Eigen::Vector3d::Zero()};
}

}  // namespace cairn
