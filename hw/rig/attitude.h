// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "hw/rig/rig_tuning.h"

namespace cairn {

/// Estimates the attitude in the world of what carries the IMU, from its gyro and, slowly, from where its
/// accelerometer finds up. The gyro's bias is learnt: all of it in each second of rest, which also tells at
/// once where up is; and else but for the part about the vertical, by which the heading drifts. What the axes
/// turn the IMU by is no bias, and encoders tell it; a slow and even turn of the wearer, below 1.7 deg/s,
/// cannot be told from one. Pure.
class Attitude {
 public:
  explicit Attitude(const AttitudeOptions& options) : options_(options) {}

  /// Takes one sample, means since the one before: rate of turn [rad/s] and acceleration [m/s^2, up at rest]
  /// in the IMU's axes, `step` [s] after the one before, and by how much the axes have turned it against the
  /// shoulder since then [rad, a rotation vector in its axes]. The first one whose acceleration can be
  /// trusted sets up, with heading 0.
  void update(const Eigen::Vector3d& rate, const Eigen::Vector3d& acceleration, double step,
              const Eigen::Vector3d& turned = Eigen::Vector3d::Zero());

  /// The world (z up) from the IMU.
  [[nodiscard]] const Eigen::Quaterniond& world_from_imu() const { return world_from_imu_; }
  /// Rate of turn at the newest sample, without bias, in the IMU's axes [rad/s].
  [[nodiscard]] const Eigen::Vector3d& rate() const { return rate_; }
  [[nodiscard]] const Eigen::Vector3d& bias() const { return bias_; }
  [[nodiscard]] bool is_known() const { return known_; }

 private:
  /// Sums of what has been measured since a second ago or less. `turn` is the shoulder's, in the IMU's axes:
  /// what the gyro says less what the axes did [rad].
  struct Second {
    double time = 0;  ///< [s]
    int samples = 0;
    Eigen::Vector3d rate = Eigen::Vector3d::Zero();          ///< sum
    Eigen::Vector3d acceleration = Eigen::Vector3d::Zero();  ///< sum
    Eigen::Vector3d turn = Eigen::Vector3d::Zero();          ///< in all
    double times = 0;                                        ///< sum of the times
    double times_squared = 0;                                ///< sum
    Eigen::Vector3d turns = Eigen::Vector3d::Zero();         ///< sum of the turns
    Eigen::Vector3d turns_squared = Eigen::Vector3d::Zero();
    Eigen::Vector3d times_turns = Eigen::Vector3d::Zero();
  };
  /// The straight line through a second's turns.
  struct Line {
    Eigen::Vector3d slope;  ///< [rad/s]
    double off;             ///< how far the turns are from it, RMS of the worst axis [rad]
  };
  [[nodiscard]] static Line line_through(const Second& second);
  void learn_at_rest(const Eigen::Vector3d& rate, const Eigen::Vector3d& acceleration, double step,
                     const Eigen::Vector3d& turned);
  /// How far the attitude is from where an acceleration finds up: a turn in the IMU's axes, for small ones.
  [[nodiscard]] Eigen::Vector3d off_upright(const Eigen::Vector3d& acceleration) const;
  void turn_by(const Eigen::Vector3d& turn);

  AttitudeOptions options_;
  Second second_;
  int rests_ = 0;
  bool known_ = false;
  double age_ = 0;  ///< [s]
  Eigen::Quaterniond world_from_imu_ = Eigen::Quaterniond::Identity();
  Eigen::Vector3d rate_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d bias_ = Eigen::Vector3d::Zero();
};

}  // namespace cairn
