// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>

#include "hw/can/xsens.h"

namespace cairn {

/// A sample of the IMU, in its own axes.
struct ImuSample {
  /// Time since the sample before, by the IMU's clock [s]; 0 for the first, and where that clock began anew.
  double step = 0;
  Eigen::Vector3d rate;          ///< [rad/s]
  Eigen::Vector3d acceleration;  ///< [m/s^2]
};

/// Puts the IMU's messages together to samples: time, rate of turn, acceleration. One of which a part was
/// lost is left out. Pure.
class ImuSampler {
 public:
  /// The sample that this message ends, if any.
  [[nodiscard]] std::optional<ImuSample> receive(const xsens::Message& message);

 private:
  std::optional<uint32_t> ticks_;  ///< of the sample that is coming in
  std::optional<Eigen::Vector3d> rate_;
  std::optional<uint32_t> last_;  ///< ticks of the newest whole one
};

}  // namespace cairn
