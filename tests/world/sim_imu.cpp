// SPDX-License-Identifier: Apache-2.0
#include "tests/world/sim_imu.h"

#include "tests/world/random.h"

namespace cairn {
namespace {

constexpr double kRateNoise = 0.003;         // [rad/s]
constexpr double kRateBias = 0.01;           // likewise
constexpr double kAccelerationNoise = 0.03;  // [m/s^2]
constexpr double kAccelerationBias = 0.05;   // likewise
constexpr double kBehind = 0.03;             // [m]
constexpr double kStep = 1e-3;               // [s] of the differences: a tremor is a hundred times as long
constexpr double kGravity = 9.80665;         // [m/s^2]

enum Stream : uint64_t { kBias = 0x696D75, kNoise = 0x696D76 };

Eigen::Vector3d normal3(Random* random, double sigma) {
  const double x = random->normal();
  const double y = random->normal();
  const double z = random->normal();
  return sigma * Eigen::Vector3d(x, y, z);
}

}  // namespace

SimImu::SimImu(double frequency, uint64_t seed) : frequency_(frequency), seed_(seed) {
  Random random(seed, kBias);
  rate_bias_ = normal3(&random, kRateBias);
  acceleration_bias_ = normal3(&random, kAccelerationBias);
}

SE3 SimImu::camera_from_imu() const {
  Eigen::Matrix3d rotation;
  rotation << 0, -1, 0,  //
      0, 0, -1,          //
      1, 0, 0;
  return {rotation, Eigen::Vector3d(0, 0, -kBehind)};
}

SimImuSample SimImu::sample(int index, const std::function<SE3(double)>& map_from_camera) const {
  const double seconds = index / frequency_;
  const SE3 before = map_from_camera(seconds - kStep) * camera_from_imu();
  const SE3 now = map_from_camera(seconds) * camera_from_imu();
  const SE3 after = map_from_camera(seconds + kStep) * camera_from_imu();
  const Eigen::Vector3d moved =
      (after.translation() - 2 * now.translation() + before.translation()) / (kStep * kStep);
  const Eigen::Vector3d held = moved + Eigen::Vector3d(0, 0, kGravity);
  Random random(seed_ ^ mix_bits(static_cast<uint64_t>(index)), kNoise);
  SimImuSample sample;
  sample.time = Timestamp::from_seconds(seconds);
  sample.rate = so3_log(before.rotation().conjugate() * after.rotation()) / (2 * kStep) + rate_bias_ +
                normal3(&random, kRateNoise);
  sample.acceleration =
      now.rotation().conjugate() * held + acceleration_bias_ + normal3(&random, kAccelerationNoise);
  return sample;
}

}  // namespace cairn
