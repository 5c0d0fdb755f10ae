// SPDX-License-Identifier: Apache-2.0
#include "tests/world/motion.h"

#include <algorithm>
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

double minimum_jerk(double part) {
  const double t = std::clamp(part, 0.0, 1.0);
  return t * t * t * (10 - 15 * t + 6 * t * t);
}

SE3 turned(const SE3& map_from_camera, std::span<const Turn> turns, double route_seconds) {
  SE3 pose = map_from_camera;
  for (const Turn& turn : turns) {
    if (route_seconds <= turn.begin || route_seconds >= turn.end()) continue;
    const double away = minimum_jerk((route_seconds - turn.begin) / turn.going) -
                        minimum_jerk((route_seconds - turn.begin - turn.going - turn.staying) / turn.going);
    const Eigen::Vector3d pivot = pose * turn.pivot;
    const Eigen::Quaterniond rotation = so3_exp({0, 0, away * turn.yaw}) * pose.rotation() *
                                        so3_exp({away * turn.pitch, 0, 0}) *
                                        so3_exp({0, 0, away * turn.roll});
    pose = SE3(rotation, Eigen::Vector3d(pivot - rotation * turn.pivot));
  }
  return pose;
}

double RouteClock::at(double seconds) const {
  if (calm <= 0) return seconds * speed;
  const double t = std::clamp(seconds - calm, 0.0, 1.0);
  const double hurrying = t * t * t * t * (2.5 - 3 * t + t * t);  // the integral of minimum_jerk()
  return seconds + (speed - 1) * (hurrying + std::max(seconds - calm - 1, 0.0));
}

double RouteClock::seconds_at(double route_seconds) const {
  if (calm <= 0) return route_seconds / speed;
  if (route_seconds <= calm) return route_seconds;
  double low = calm;
  double high = calm + 1 + route_seconds / std::min(speed, 1.0);
  for (int i = 0; i < 60; ++i) {
    const double middle = (low + high) / 2;
    (at(middle) < route_seconds ? low : high) = middle;
  }
  return high;
}

HandMotion::HandMotion(std::vector<Waypoint> route, double interval, const RouteClock& clock, uint64_t seed,
                       double steadiness)
    : route_(std::move(route)), interval_(interval), clock_(clock) {
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
  const double route_seconds = clock_.at(seconds);
  Vector6d shake;
  for (size_t axis = 0; axis < 6; ++axis) {
    shake[static_cast<int>(axis)] = sum_at(sway_[axis], route_seconds) + sum_at(tremor_[axis], seconds);
  }
  return look_at(route_at(route_seconds)) * SE3(so3_exp(shake.tail<3>()), Eigen::Vector3d(shake.head<3>()));
}

}  // namespace cairn
