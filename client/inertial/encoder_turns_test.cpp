// SPDX-License-Identifier: Apache-2.0
#include "client/inertial/encoder_turns.h"

#include <gtest/gtest.h>

#include <cmath>

#include "common/geometry/se3.h"

namespace cairn {
namespace {

/// A head that is panned to and fro, and tilted.
Eigen::Quaterniond base_from_camera(double t) {
  return so3_exp({0, 0, std::sin(3 * t)}) * so3_exp({0, 0.4 * std::cos(2 * t), 0});
}

std::vector<EncoderSample> from(double begin, double end) {
  std::vector<EncoderSample> samples;
  for (int i = 0; begin + 0.01 * i <= end; ++i)
    samples.push_back({Timestamp::from_seconds(begin + 0.01 * i), base_from_camera(begin + 0.01 * i)});
  return samples;
}

Timestamp at(double seconds) {
  return Timestamp::from_seconds(seconds);
}

TEST(EncoderTurns, TurnAsTheCameraDoes) {
  EncoderTurns encoders{EncoderTurnOptions()};
  encoders.add(from(0, 10));
  for (double t = 8.5; t < 9.9; t += 0.0431) {
    const auto turn = encoders.turn(at(t), at(t + 0.0333));
    ASSERT_TRUE(turn) << t;
    const Eigen::Quaterniond truth = base_from_camera(t + 0.0333).conjugate() * base_from_camera(t);
    EXPECT_LT(turn->angularDistance(truth), 5e-4) << t;
  }
}

TEST(EncoderTurns, DoNotAnswerWhereSamplesAreMissing) {
  EncoderTurns encoders{EncoderTurnOptions()};
  EXPECT_FALSE(encoders.turn(at(0), at(1)));
  encoders.add(from(1, 2));
  EXPECT_FALSE(encoders.turn(at(0.99), at(1.5)));
  EXPECT_TRUE(encoders.turn(at(1.5), at(2.015)));
  EXPECT_FALSE(encoders.turn(at(1.5), at(2.03)));
  encoders.add(from(2.1, 2.5));
  EXPECT_FALSE(encoders.turn(at(1.9), at(2.05))) << "in a gap";
  EXPECT_TRUE(encoders.turn(at(1.9), at(2.2))) << "across it: both ends are known";
  encoders.add(from(1.2, 1.5));
  EXPECT_FALSE(encoders.turn(at(1.9), at(2.2))) << "begun anew";
  EXPECT_TRUE(encoders.turn(at(1.3), at(1.4)));
}

}  // namespace
}  // namespace cairn
