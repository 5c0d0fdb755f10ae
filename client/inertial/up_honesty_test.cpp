// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <cmath>
#include <iostream>
#include <random>
#include <vector>

#include "client/inertial/inertial_sensor.h"
#include "common/geometry/se3.h"

/// Whether the sigma of up is what the error is like, for the accelerations and turns of a camera that is
/// worn, by sensors as small devices have them.
namespace cairn {
namespace {

constexpr double kGravity = 9.80665;
constexpr double kRate = 200;   ///< [Hz] of samples
constexpr double kFrames = 25;  ///< [Hz]
constexpr double kSettled = 8;  ///< [s] after which the gyro's bias has been learnt
constexpr double kSeconds = 30;
constexpr double kGate = 13.816;  ///< chi-square of two degrees of freedom, 99.9 %

/// How a camera moves, by phases of its own.
struct Motion {
  double bounce = 0;     ///< [m/s^2] up and down, twice a step pair, the second harmonic a third of it
  double sway = 0;       ///< [m/s^2] to the sides, once a step pair
  double surge = 0;      ///< [m/s^2] forward and back, as often as it bounces
  double turn = 0;       ///< [rad] of the camera, about all axes
  double step_pair = 1;  ///< [Hz]
};
constexpr Motion kStanding{.bounce = 0.1, .sway = 0.1, .surge = 0.1, .turn = 0.05, .step_pair = 0.4};
constexpr Motion kWalking{.bounce = 2.5, .sway = 1.0, .surge = 1.5, .turn = 0.12, .step_pair = 0.95};
constexpr Motion kHurrying{.bounce = 5, .sway = 2, .surge = 3, .turn = 0.25, .step_pair = 1.3};

class Wearer {
 public:
  Wearer(const Motion& motion, uint64_t seed) : motion_(motion), random_(seed) {
    std::uniform_real_distribution<double> phase(0, 2 * M_PI);
    for (double& p : phases_) p = phase(random_);
    std::normal_distribution<double> normal;
    const auto draw = [&](double sigma) {
      return Eigen::Vector3d{sigma * normal(random_), sigma * normal(random_), sigma * normal(random_)};
    };
    gyro_bias_ = draw(0.01);
    acceleration_bias_ = draw(0.05);
  }
  [[nodiscard]] Eigen::Quaterniond world_from_camera(double t) const {
    const double w = 2 * M_PI * motion_.step_pair * t;
    return so3_exp(motion_.turn * Eigen::Vector3d(std::sin(2 * w + phases_[0]), std::sin(w + phases_[1]),
                                                  std::sin(0.37 * w + phases_[2])));
  }
  [[nodiscard]] Eigen::Vector3d up(double t) const {
    return world_from_camera(t).conjugate() * Eigen::Vector3d::UnitZ();
  }
  ImuSample sample(double t) {
    constexpr double kStep = 1e-4;
    std::normal_distribution<double> normal;
    const auto noise = [&](double sigma) {
      return Eigen::Vector3d{sigma * normal(random_), sigma * normal(random_), sigma * normal(random_)};
    };
    ImuSample sample;
    sample.time = Timestamp::from_seconds(t);
    sample.rate =
        so3_log(world_from_camera(t - kStep).conjugate() * world_from_camera(t + kStep)) / (2 * kStep) +
        gyro_bias_ + noise(0.003);
    sample.acceleration = world_from_camera(t).conjugate() * (moved(t) + Eigen::Vector3d(0, 0, kGravity)) +
                          acceleration_bias_ + noise(0.03);
    return sample;
  }
  [[nodiscard]] Eigen::Quaterniond turn(double from, double to) const {
    return world_from_camera(to).conjugate() * world_from_camera(from);
  }

 private:
  [[nodiscard]] Eigen::Vector3d moved(double t) const {
    const double w = 2 * M_PI * motion_.step_pair * t;
    return {motion_.surge * std::sin(2 * w + phases_[3]), motion_.sway * std::sin(w + phases_[4]),
            motion_.bounce * (std::sin(2 * w + phases_[5]) + std::sin(4 * w + phases_[6]) / 3)};
  }

  Motion motion_;
  std::mt19937_64 random_;
  std::array<double, 7> phases_{};
  Eigen::Vector3d gyro_bias_;
  Eigen::Vector3d acceleration_bias_;
};

struct Honesty {
  int asked = 0;
  int known = 0;
  int gated = 0;       ///< farther off than one true direction in a thousand should be
  double squared = 0;  ///< sum of squared errors over sigma: about 2 each, if it is honest
  double error = 0;    ///< sum of squares [rad^2]
};

Honesty measure(const Motion& motion) {
  Honesty honesty;
  for (uint64_t seed = 1; seed <= 20; ++seed) {
    Wearer wearer(motion, seed);
    InertialSensor sensor(ImuMount{}, InertialSensorOptions());
    const int per_frame = static_cast<int>(kRate / kFrames);
    for (int frame = 1; frame < kSeconds * kFrames; ++frame) {
      std::vector<ImuSample> samples;
      for (int i = 0; i < per_frame; ++i)
        samples.push_back(wearer.sample((frame - 1) / kFrames + (i + 1) / kRate));
      sensor.add(samples);
      const double t = frame / kFrames;
      const double before = t - 1 / kFrames;
      sensor.tracked(Timestamp::from_seconds(before), Timestamp::from_seconds(t), wearer.turn(before, t));
      if (t < kSettled) continue;
      ++honesty.asked;
      const auto up = sensor.up(Timestamp::from_seconds(t));
      if (!up) continue;
      ++honesty.known;
      const double error = angle_between(*up, {wearer.up(t), 0});
      const double squared = error * error / (up->sigma * up->sigma);
      honesty.gated += squared > kGate ? 1 : 0;
      honesty.squared += squared;
      honesty.error += error * error;
    }
  }
  std::cout << "known " << honesty.known << " of " << honesty.asked << ", normalized squared error "
            << honesty.squared / honesty.known << ", error "
            << std::sqrt(honesty.error / honesty.known) * 180 / M_PI << " degrees, gated " << honesty.gated
            << "\n";
  return honesty;
}

void expect_honest(const Honesty& honesty) {
  ASSERT_GT(honesty.known, honesty.asked / 2);
  EXPECT_LT(honesty.squared / honesty.known, 2.5) << "two degrees of freedom";
  EXPECT_LE(honesty.gated, honesty.known / 500);
}

TEST(UpHonesty, OfWhoStands) {
  expect_honest(measure(kStanding));
}

TEST(UpHonesty, OfWhoWalks) {
  expect_honest(measure(kWalking));
}

TEST(UpHonesty, OfWhoHurries) {
  expect_honest(measure(kHurrying));
}

}  // namespace
}  // namespace cairn
