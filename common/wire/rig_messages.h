// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/time.h"
#include "common/wire/messages.h"

/// The topics RigState and RigCommand, by which a rig, its commander and the server speak, in the partition
/// of the rig. Arrays of two are pan and tilt. Angles of the axes: pan turns to the left, tilt up; at 0, 0
/// the camera looks along the base's x (base: x forward, y left, z up).
namespace cairn::wire {

/// What a rig is told to do, and what it does.
enum class RigMode : uint8_t {
  kIdle = 0,        ///< the drives let go
  kHome = 1,        ///< learns where the axes stand
  kNeutral = 2,     ///< ahead
  kFollow = 3,      ///< ahead, slowly with the wearer
  kLock = 4,        ///< a direction of the world
  kFixate = 5,      ///< a point of the map
  kSaccade = 6,     ///< to other angles, as fast as may be
  kSearch = 7,      ///< looks around
  kJog = 8,         ///< by hand
  kClear = 9,       ///< faults are forgotten; of a command only
  kStop = 10,       ///< emergency stop, by anybody, until it is cleared
  kClearStop = 11,  ///< of a command only
  kLast = kClearStop,
};
/// The mode's name as people say it: "clear-stop".
[[nodiscard]] std::string_view name_of(RigMode mode);
[[nodiscard]] std::optional<RigMode> parse_rig_mode(std::string_view name);

/// The order in which a search looks at places that are not ranked.
enum class RigSearchPattern : uint8_t {
  kSpiral = 0,  ///< around where it began
  kRaster = 1,  ///< in rows
  kLast = kRaster,
};
/// "spiral", "raster".
[[nodiscard]] std::optional<RigSearchPattern> parse_rig_search(std::string_view name);
inline constexpr size_t kMaxFurtherDirections = 7;

/// Topic RigCommand: a commander's order. It is said again and again, at 20 Hz or more, as long as it holds:
/// a rig without a commander lets its drives go. An order is carried out when its number is new; said again,
/// it moves the target and nothing else, so that drives that were let go do not start by themselves.
struct RigCommand {
  std::string rig;        ///< name
  std::string commander;  ///< name
  CommandId order;
  RigMode mode = RigMode::kIdle;
  /// Lock: a direction of the rig's world (z up), of any length; 0: where the camera looks at that moment.
  /// Fixate: the point as the camera saw it (x right, y down, z forward), in any unit that stays; 0: not
  /// seen. Search: the direction to begin with; 0: none. When the order is new.
  Eigen::Vector3d target = Eigen::Vector3d::Zero();
  Timestamp seen;                  ///< fixate: when the image was taken, by the host's clock
  std::array<double, 2> angles{};  ///< saccade [rad]
  std::array<double, 2> rates{};   ///< jog [rad/s]
  RigSearchPattern pattern = RigSearchPattern::kSpiral;
  /// Search: where to look after `target`, the likeliest first, at most kMaxFurtherDirections. When the order
  /// is new.
  std::vector<Eigen::Vector3d> further;
};

enum class RigAxisCondition : uint8_t {
  kUnknown = 0,  ///< not homed
  kHoming = 1,
  kIdle = 2,
  kActivating = 3,
  kActive = 4,
  kClearing = 5,
  kFaulted = 6,
  kStopped = 7,
  kLast = kStopped,
};

struct RigAxisState {
  RigAxisCondition condition = RigAxisCondition::kUnknown;
  uint8_t fault = 0;  ///< 0: none; else which, from 1: hw/README.md
  bool position_known = false;
  double position = 0;  ///< [rad]
  double rate = 0;      ///< [rad/s]
};

/// The IMU's newest sample and the attitude. The attitude is that of the head, on which the IMU sits: x where
/// the camera looks, y left, z up. What the IMU measured is in its own axes, as in RigImuSample.
struct RigImu {
  Timestamp time;                                          ///< when it was taken, by the host's clock
  Eigen::Vector3f rate = Eigen::Vector3f::Zero();          ///< as measured [rad/s]
  Eigen::Vector3f acceleration = Eigen::Vector3f::Zero();  ///< likewise [m/s^2]
  bool attitude_known = false;
  Eigen::Quaterniond world_from_head = Eigen::Quaterniond::Identity();  ///< z up, heading 0 at the start
  int64_t clock_offset = 0;  ///< the host's time less the IMU's own [ns]
};

/// How the camera's stamps differ from those of the IMU, as estimated from the poses of the camera's tracker.
struct RigCameraClock {
  bool known = false;  ///< estimated; not the configuration's
  int64_t offset = 0;  ///< the IMU's stamp of a moment less the camera's [ns]
  float sigma = 0;     ///< standard deviation of that [s]
};

/// A sample of the IMU, in its own axes.
struct RigImuSample {
  Timestamp time;                                          ///< when it was taken, by the host's clock
  Eigen::Vector3f rate = Eigen::Vector3f::Zero();          ///< as measured [rad/s]
  Eigen::Vector3f acceleration = Eigen::Vector3f::Zero();  ///< likewise [m/s^2]
};
/// Most samples in a RigState: at 400 samples a second, the most that a rig takes, each is in two or three
/// states.
constexpr size_t kMaxRigSamples = 10;

/// Topic RigState: presence.
struct RigState {
  std::string rig;
  Timestamp time;                 ///< by the host's clock
  RigMode mode = RigMode::kIdle;  ///< what it does
  std::string commander;          ///< empty: none
  CommandId order;                ///< the last one that was judged; of session 0: none yet
  std::string refusal;            ///< why that was not carried out, for a person; empty: it was
  bool stopped = false;           ///< emergency stop
  bool drives_idle = true;        ///< told so, and nothing told since
  std::array<RigAxisState, 2> axes;
  bool has_imu = false;
  RigImu imu;
  std::string trouble;  ///< what keeps it from moving and what helps, for a person; empty: nothing
  // Of the mode.
  bool on_target = false;
  bool out_of_reach = false;  ///< the target is beyond the limits
  bool sees_target = false;   ///< fixate: sightings come
  float looked_at = 0;        ///< search: share of the places within reach, of this round
  uint32_t rounds = 0;        ///< search: how often all of them were looked at
  RigCameraClock camera_clock;
  // Of the order that was judged last.
  std::string ordered_by;            ///< name of who gave it; empty: none yet
  RigMode ordered = RigMode::kIdle;  ///< what it was
  // For the tracker of the camera. A rig of before these does not say them, and so has no IMU.
  /// The newest ones in order of time. States may be lost: each sample is said again in those that follow, at
  /// least in one.
  std::vector<RigImuSample> samples;
  std::optional<Eigen::Quaterniond> camera_from_imu;  ///< nothing: the configuration does not know
  /// [ns] The offset of RigCameraClock as the configuration has it. It counts while none is estimated.
  /// Nothing: not known.
  std::optional<int64_t> calibrated_offset;
  /// The rotation from the camera to the base at `time`, by the encoders. Nothing: axes are not homed, or do
  /// not answer.
  std::optional<Eigen::Quaterniond> base_from_camera;
};

/// [ns] What must be added to a stamp of the camera to get the IMU's of the same moment: as estimated at
/// work, else as calibrated. Nothing: not known.
[[nodiscard]] std::optional<int64_t> camera_offset(const RigState& state);

/// [bytes] Longest text in a RigState.
constexpr size_t kMaxRigText = 360;
/// [bytes] Most for its refusal and its trouble together, as rigs write them: a state is one packet, with
/// room for what a later one has to say.
constexpr size_t kMaxRigTexts = 400;

}  // namespace cairn::wire
