// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <span>
#include <vector>

#include "client/inertial/gyro_bias.h"
#include "client/inertial/imu_sample.h"
#include "client/inertial/up_filter.h"

namespace cairn {

/// How a camera turned from one moment to another.
struct CameraTurn {
  Eigen::Quaterniond now_from_before = Eigen::Quaterniond::Identity();
  double sigma = 0;  ///< [rad], per axis
};

struct InertialSensorOptions {
  double most_gap = 0.05;    ///< [s] between two samples
  double most_ahead = 0.02;  ///< [s] that the newest rate is believed beyond its sample
  double kept = 2;           ///< [s] for which samples are kept
  double jump = 1;           ///< [s] back, which no reordering explains
  double noise = 2e-4;       ///< [rad per square root of a second] small devices
  /// A hand's greatest change of its rate [rad/s^2]: what a rate that is held on to may be off by.
  double turn_acceleration = 50;
  /// [rad/s^3]: that acceleration as one of five times a second changes it. A rate that is drawn straight
  /// between two samples is off by it.
  double turn_jerk = 1500;
  GyroBiasOptions bias;
  UpFilterOptions up;
};

/// What the IMU that is fixed to a camera tells about the camera: how it turned, and where up is. The gyro's
/// bias is learnt from turns that the camera's images tell. All times are by the camera's clock, all axes the
/// camera's. Pure; one thread.
class InertialSensor {
 public:
  explicit InertialSensor(const ImuMount& mount, const InertialSensorOptions& options);

  /// Sets how the IMU's axes and clock relate to the camera's, when more is known about that. It counts for
  /// earlier samples too. Where the axes differ, everything is begun anew, the bias as well.
  void use(const ImuMount& mount);

  /// Samples in order of time. Those before the newest that there is are not used, unless time goes back by
  /// more than a second: then everything but the bias is begun anew (a recording may jump).
  void add(std::span<const ImuSample> samples);

  /// The turn of the camera from one moment to another. Nothing where samples are missing: before the first,
  /// across a gap of more than 50 ms, or when the newest is older than `to` by more than 20 ms.
  [[nodiscard]] std::optional<CameraTurn> turn(Timestamp from, Timestamp to) const;
  /// The direction up at a moment of the last two seconds; nothing where that is not known well enough.
  [[nodiscard]] std::optional<UpDirection> up(Timestamp time) const;

  /// The camera has turned so, by images that leave no doubt.
  void tracked(Timestamp from, Timestamp to, const Eigen::Quaterniond& now_from_before);
  /// Whether the gyro contradicts the images: it sits otherwise, its clock or its unit is another one.
  [[nodiscard]] bool contradicts_images() const { return bias_.leaves_turns_unexplained(); }
  [[nodiscard]] const Eigen::Vector3d& bias() const { return bias_.value(); }  ///< [rad/s]

 private:
  struct Rate {
    Timestamp time;
    Eigen::Vector3d rate;  ///< as measured
  };
  [[nodiscard]] std::optional<size_t> first_needed(Timestamp from) const;

  InertialSensorOptions options_;
  ImuMount mount_;
  std::vector<Rate> rates_;  ///< of the last seconds
  GyroBias bias_;
  UpFilter up_;
};

}  // namespace cairn
