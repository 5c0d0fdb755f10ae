// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <string>
#include <string_view>
#include <utility>

#include "hw/rig/rig_configuration.h"

// For tests only.
namespace cairn::testing {

inline double angle_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

/// A sound configuration.
constexpr const char* kRigText =
    "name: shoulder\n"
    "period: 10            # [ms] between setpoints\n"
    "deadlines: {commander: 60, imu: 50, drive: 50}  # [ms]\n"
    "imu: {rate: 100}\n"
    "axes:\n"
    "  pan:\n"
    "    node: 16\n"
    "    gear: 20          # turns of the motor for one of the axis; negative: it turns the other way\n"
    "    home: -56         # [deg] of the homing switch\n"
    "    position: [-58, 58]\n"
    "    margin: 5\n"
    "    rate: 120         # [deg/s]\n"
    "    acceleration: 500 # [deg/s^2]\n"
    "    coasting: 250     # [deg/s^2] by friction alone\n"
    "    gain: 20\n"
    "    current: 5        # [A]\n"
    "    lag: 7            # [ms]\n"
    "    backlash: 0.3     # [deg]\n"
    "    neutral: 0\n"
    "  tilt: {node: 17, gear: -20, home: 36, position: [-40, 40], margin: 5, rate: 120, acceleration: 500, "
    "coasting: 250, gain: 20, current: 5, neutral: 0, lag: 7, "
    "backlash: 0.3}\n";

/// A rig that is quick enough for a wearer who walks at 2 Hz.
inline std::string walking_rig() {
  std::string text = kRigText;
  for (const auto& [from, to] : {std::pair{"rate: 120", "rate: 180"},
                                 {"acceleration: 500", "acceleration: 2000"},
                                 {"current: 5", "current: 10"}}) {
    for (size_t at = 0; (at = text.find(from, at)) != std::string::npos; ++at)
      text.replace(at, std::string_view(from).size(), to);
  }
  return text;
}

/// Reads a configuration file with that text.
[[nodiscard]] inline Result<RigConfiguration> read_rig(const std::string& text) {
  std::string name = ::testing::UnitTest::GetInstance()->current_test_info()->name();
  std::replace(name.begin(), name.end(), '/', '_');
  const std::string path =
      ::testing::TempDir() + "rig_test_" + name + "_" + std::to_string(getpid()) + ".yaml";
  std::ofstream(path) << text;
  auto configuration = read_rig_configuration(path);
  std::remove(path.c_str());
  return configuration;
}

}  // namespace cairn::testing
