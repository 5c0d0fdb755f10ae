// SPDX-License-Identifier: Apache-2.0
#include "tests/world/motion.h"

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "tests/world/random.h"

namespace cairn {
namespace {

// Amplitudes that give the speeds and jerks of hand-held recordings (TUM fr1_xyz: 0.33 m/s, 19 deg/s, 0.9
// m/s^2 RMS).
constexpr double kSwayTranslation = 0.004;  // m RMS per axis
constexpr double kSwayRotation = 0.014;     // rad RMS per axis
constexpr double kTremorTranslation = 1.2e-4;
constexpr double kTremorRotation = 6e-4;

double sum_at(const auto& waves, double seconds) {
  double sum = 0;
  for (const auto& wave : waves)
    sum += wave.amplitude * std::sin(wave.angular_frequency * seconds + wave.phase);
  return sum;
}

/// Camera at `eye` looking at `target`, no roll: x right, y down, z forward; map Z is up.
SE3 look_at(const Waypoint& view) {
  Eigen::Matrix3d map_from_camera;
  map_from_camera.col(2) = (view.target - view.eye).normalized();
  map_from_camera.col(0) = map_from_camera.col(2).cross(Eigen::Vector3d::UnitZ()).normalized();
  map_from_camera.col(1) = map_from_camera.col(2).cross(map_from_camera.col(0));
  return {map_from_camera, view.eye};
}

}  // namespace

HandMotion::HandMotion(std::vector<Waypoint> route, double interval, double speed, uint64_t seed,
                       double steadiness)
    : route_(std::move(route)), interval_(interval), speed_(speed) {
  if (route_.size() < 4) throw std::invalid_argument("hand motion: four waypoints or more");
  for (size_t axis = 0; axis < 6; ++axis) {
    const bool rotation = axis >= 3;
    sway_[axis] =
        make_waves(0.3, 2.5, 7, (rotation ? kSwayRotation : kSwayTranslation) / steadiness, seed, axis);
    tremor_[axis] = make_waves(6.5, 9.5, 5, (rotation ? kTremorRotation : kTremorTranslation) / steadiness,
                               seed, axis + 6);
  }
}

HandMotion::Waves HandMotion::make_waves(double low_hz, double high_hz, int count, double rms, uint64_t seed,
                                         uint64_t stream) {
  Random random(seed, 0x686E64 + stream);
  Waves waves;
  double power = 0;
  for (int i = 0; i < count; ++i) {
    // One frequency from each equal-ratio band, amplitude falling with frequency as in a random walk.
    const double hz = low_hz * std::pow(high_hz / low_hz, (i + random.unit()) / count);
    waves.push_back({2 * std::numbers::pi * hz, random.uniform(0.0, 2 * std::numbers::pi), 1 / hz});
    power += 0.5 / (hz * hz);
  }
  for (Wave& wave : waves) wave.amplitude *= rms / std::sqrt(power);
  return waves;
}

double HandMotion::period() const {
  return interval_ * static_cast<double>(route_.size()) / speed_;
}

Waypoint HandMotion::route_at(double route_seconds) const {
  const double position = route_seconds / interval_;
  const double knot = std::floor(position);
  const double t = position - knot;
  const std::array<double, 4> weights = {(1 - t) * (1 - t) * (1 - t) / 6, (3 * t * t * t - 6 * t * t + 4) / 6,
                                         (-3 * t * t * t + 3 * t * t + 3 * t + 1) / 6, t * t * t / 6};
  const auto count = static_cast<int64_t>(route_.size());
  Waypoint view{Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  for (int64_t i = 0; i < 4; ++i) {
    const int64_t wrapped = ((static_cast<int64_t>(knot) + i) % count + count) % count;
    const Waypoint& control = route_[static_cast<size_t>(wrapped)];
    view.eye += weights[static_cast<size_t>(i)] * control.eye;
    view.target += weights[static_cast<size_t>(i)] * control.target;
  }
  return view;
}

SE3 HandMotion::map_from_camera(double seconds) const {
  Vector6d shake;
  for (size_t axis = 0; axis < 6; ++axis) {
    shake[static_cast<int>(axis)] = sum_at(sway_[axis], seconds * speed_) + sum_at(tremor_[axis], seconds);
  }
  return look_at(route_at(seconds * speed_)) *
         SE3(so3_exp(shake.tail<3>()), Eigen::Vector3d(shake.head<3>()));
}

}  // namespace cairn
