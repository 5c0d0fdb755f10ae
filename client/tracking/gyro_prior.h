// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "client/inertial/encoder_turns.h"
#include "client/inertial/inertial_sensor.h"
#include "client/tracking/frame_result.h"
#include "common/base/time.h"
#include "common/geometry/se3.h"

namespace cairn {

struct GyroPriorOptions {
  double sigmas = 3;  ///< [sigma] of errors that a search about the turn must make good
  InertialSensorOptions sensor;
  EncoderTurnOptions encoders;
};

/// Tells how the camera turned since the frame before, by the gyro that is fixed to it or else by the
/// encoders of the rig that carries it, and for how long the gyro alone may be relied on. Pure; one thread.
class GyroPrior {
 public:
  explicit GyroPrior(const GyroPriorOptions& options) : options_(options), encoders_(options.encoders) {}

  /// The camera has an IMU that sits so, from now on; nothing: it has none, or that is not known.
  void use(const std::optional<ImuMount>& mount);
  void add(std::span<const ImuSample> samples) {
    if (sensor_) sensor_->add(samples);
  }

  /// The camera is on a rig, whose encoders say this. It counts where there are no samples of a gyro.
  void add(std::span<const EncoderSample> samples) { encoders_.add(samples); }

  /// The pose known is of this frame already: the turn since the frame before is in it.
  void counted() {
    if (turn_) turn_ = SE3();
  }

  /// A frame begins.
  void next_frame(Timestamp time);
  /// The camera's turn since the frame before (now from before): by the gyro, or where it has no samples by
  /// the encoders of a rig. Nothing where there are neither, and while the gyro contradicts the images.
  [[nodiscard]] const std::optional<SE3>& turn() const { return turn_; }
  /// Whether the gyro told turn(), and not the encoders of a rig, which know nothing of who carries the rig.
  [[nodiscard]] bool is_by_gyro() const { return turn_sigma_.has_value(); }
  [[nodiscard]] ImuUse use() const;
  /// The direction up in this frame; nothing where that is not known.
  [[nodiscard]] std::optional<UpDirection> up() const;

  /// The frame was tracked well, and the camera moved so since it was tracked last.
  void tracked(const SE3& now_from_before);
  /// The frame was tracked, or its bearings were followed.
  void seen() { blind_sigma_ = 0; }
  /// Whether the gyro alone may say how the camera turned in this frame, in which nothing else does; ask once
  /// a frame. False where it tells no turn, and where some sigma of its errors, which add up, are more than
  /// `reach` [rad], the error that a search about the turn can make good.
  [[nodiscard]] bool carries(double reach);
  /// [rad], per axis: of the turns that the gyro alone has told since something was seen.
  [[nodiscard]] double blind_sigma() const { return blind_sigma_; }

 private:
  GyroPriorOptions options_;
  std::optional<InertialSensor> sensor_;
  EncoderTurns encoders_;
  std::optional<Timestamp> before_;
  std::optional<Timestamp> now_;
  std::optional<SE3> turn_;
  std::optional<double> turn_sigma_;  ///< of a gyro's; what carries the rig may turn as it likes
  bool is_missing_ = false;
  bool was_sharp_ = false;  ///< the frame before was tracked well, and
  bool is_sharp_ = false;   ///< this one is
  double blind_sigma_ = 0;
};

}  // namespace cairn
