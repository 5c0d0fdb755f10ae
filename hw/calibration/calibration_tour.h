// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/base/time.h"
#include "hw/calibration/clock_offset.h"
#include "hw/calibration/hand_eye.h"
#include "hw/rig/rig_configuration.h"

namespace cairn {

/// The rig's report on itself. Times of a tour are of one clock, the rig's.
struct TourReport {
  Timestamp when;
  bool is_homed = false;  ///< both axes know where they stand
  bool is_idle = true;    ///< the drives are let go
  PanTilt angles;         ///< of the encoders, where homed
  PanTilt rates;
  std::string
      trouble;  ///< why it does not move and what helps, or why it refused the last order; empty: nothing
};

/// The report of the tracker of the rig's camera.
struct TourPose {
  Timestamp when;  ///< of the image
  bool is_tracked = false;
  std::string map;  ///< poses in different ones say nothing of each other
  Eigen::Quaterniond map_from_camera = Eigen::Quaterniond::Identity();
  Eigen::Vector3d camera_in_map = Eigen::Vector3d::Zero();
};

/// The order that a tour gives the rig.
struct TourOrder {
  enum class What : uint8_t { kNothing, kHome, kJog, kIdle };
  What what = What::kNothing;
  PanTilt rates;  ///< kJog [rad/s]
};

struct TourFindings {
  HandEye hand_eye;
  size_t glances = 0;                 ///< that hand_eye is of, or leaves out
  std::optional<CameraAndGyro> gyro;  ///< nothing for a rig without an IMU
  RigCalibration calibration;         ///< for the configuration
};

/// Calibrates a rig by a tour: it is homed, looks at some places about neutral while the tracker of its
/// camera has a map, and is shaken gently. All within the soft limits, and slowly. Whoever runs it hands in
/// what comes, gives the rig the order of advance() and says the words to the person. Pure.
class CalibrationTour {
 public:
  /// Error kConfiguration where the limits leave too little to look around.
  [[nodiscard]] static Result<CalibrationTour> plan(const RigConfiguration& configuration, Timestamp now);

  void take(const TourReport& report);
  void see(const TourPose& pose);
  void sense(const GyroSample& sample);

  /// Whether rig and tracker are there; nothing has moved yet.
  [[nodiscard]] bool is_ready() const { return step_ == Step::kReady; }
  /// Begins to move, once is_ready(): the person has agreed.
  void begin(Timestamp now);
  /// The order that holds from now on. Error kRefused, with the remedy: the tour has ended without findings.
  [[nodiscard]] Result<TourOrder> advance(Timestamp now);
  /// Whether the last step is over.
  [[nodiscard]] bool is_over() const { return step_ == Step::kOver; }
  /// The findings. Error kRefused, with the remedy, where what was seen tells too little.
  [[nodiscard]] Result<TourFindings> conclude() const;

  /// The words for the person since the last call.
  [[nodiscard]] std::vector<std::string> take_words();
  /// Says what the axes will do, for the question whether they may.
  [[nodiscard]] std::string announcement() const;

 private:
  enum class Step : uint8_t {
    kWaiting,
    kReady,
    kHoming,
    kMoving,
    kGlancing,
    kToMiddle,
    kShaking,
    kLeaving,
    kOver
  };

  CalibrationTour(const RigConfiguration& configuration, std::vector<PanTilt> places, Timestamp now);
  void enter(Step step, Timestamp now);
  [[nodiscard]] double in_step(Timestamp now) const { return seconds_between(now, entered_); }
  [[nodiscard]] Status look_after(Timestamp now);
  [[nodiscard]] Result<TourOrder> wait(Timestamp now);
  [[nodiscard]] Result<TourOrder> home(Timestamp now);
  [[nodiscard]] Result<TourOrder> move(Timestamp now);
  [[nodiscard]] Result<TourOrder> glance(Timestamp now);
  [[nodiscard]] Result<TourOrder> shake(Timestamp now);
  [[nodiscard]] Result<TourOrder> leave(Timestamp now);
  [[nodiscard]] TourOrder towards(const PanTilt& place) const;
  [[nodiscard]] bool is_at(const PanTilt& place) const;
  [[nodiscard]] PanTilt place() const;
  void end_glance(Timestamp now);
  void end_shake(Timestamp now);
  void next_place(Timestamp now);
  void say(std::string words) { words_.push_back(std::move(words)); }

  RigConfiguration configuration_;
  std::vector<PanTilt> places_;
  Step step_ = Step::kWaiting;
  Timestamp entered_;
  std::optional<TourReport> report_;
  std::optional<TourPose> pose_;    ///< the newest
  std::optional<Timestamp> heard_;  ///< when a pose came last, by advance()
  std::optional<Timestamp> tracked_;
  bool has_news_ = false;
  std::optional<Timestamp> at_place_;  ///< since when
  std::optional<Timestamp> idle_;      ///< since when, unasked
  size_t next_ = 0;                    ///< of places_
  std::string map_;
  struct Look {
    std::vector<TourPose> poses;
    PanTilt angles;  ///< sum of
    int reports = 0;
  };
  Look look_;
  std::vector<Glance> glances_;
  int shakes_ = 0;
  std::vector<GyroSample> gyro_;  ///< of the present shake
  std::vector<CameraRotation> rotations_;
  std::optional<Result<CameraAndGyro>> gyro_found_;
  std::vector<std::string> words_;
};

}  // namespace cairn
