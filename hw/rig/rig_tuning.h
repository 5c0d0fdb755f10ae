// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <numbers>

#include "common/base/option_list.h"

/// The constants of a rig's parts, with unit and source; the defaults are those of the rig of shoulder.yaml
/// on a wearer who walks. Of the protections, what another rig may need is here, within ranges in which it
/// still protects.
namespace cairn {

/// Options of an axis as a state machine (axis).
struct AxisOptions {
  std::chrono::milliseconds homing_time{60'000};  ///< after which homing has failed
  double rate_headroom = 1.2;  ///< of the drive's own limit over that of the setpoints, to catch up
  double runaway_rate = 1.6;   ///< of the limit: no setpoint and no catching up is so fast
  double jump = 0.05;          ///< [rad]: nothing turns so far at once, so the drive has begun anew
  double jump_rate = 3;        ///< of the limit: how much farther it may be for each second of silence
};

/// Options by which an axis counts as stuck (stall_watch).
struct StallOptions {
  double window = 0.1;  ///< [s] over which the ways of setpoint and axis are compared
  /// [rad] Setpoints that go less far in the window tell nothing: backlash.
  double told = 0.5 * std::numbers::pi / 180;
  double still = 0.3;  ///< of the way of the setpoints: an axis that goes less far stands
  /// [s] What a start takes until the axis follows, and [periods] until it has been told and measured; the
  /// longer of the two.
  double still_for = 0.04;
  double still_periods = 3;
  double far_behind = 4 * std::numbers::pi / 180;  ///< [rad]: an axis so far off that comes no nearer is held
  double behind_for = 0.1;                         ///< [s]
};

/// Options of the times at which setpoints are sent (rig), and of the watch on the IMU's rate (imu_watch).
struct RigTimingOptions {
  double in_step = 0.01;          ///< of a sample: a period so near to a whole number of samples is in step
  double behind_sample = 0.0003;  ///< [s] from a sample to the setpoints: more than most are late by
  double step_share = 0.02;       ///< of a period, by which setpoints are moved at each sample
  int most_periods = 5;           ///< made up for at once; setpoints of longer ago are left out
  double imu_rate_off = 0.1;      ///< of the rate that the configuration says: a larger error is a fault
};

/// Options of the head's attitude in the world (attitude).
struct AttitudeOptions {
  double trusted = 0.2;           ///< of gravity: further from it, one acceleration does not tell where up is
  double uprighting = 0.15;       ///< [1/s] slow beside a step of the wearer
  double bias_learning = 0.0056;  ///< [1/s^2] a quarter of its square, so that nothing swings
  double first = 0.5;             ///< [s] at first it is the mean of all accelerations
  double rest = 1;                ///< [s] of a rest, from which the gyro's bias is learnt
  double rest_off = 0.0017;       ///< [rad] half the play of a small gear stays within it, a wearer does not
  double highest_bias = 0.03;     ///< [rad/s]
  int most_rests = 20;            ///< that are averaged
};

/// Options of the base's motion under the head (base_motion, sway).
struct BaseOptions {
  double smoothing = 0.04;    ///< [s] of the acceleration: a step of the wearer takes ten times as long
  double sway_forgotten = 2;  ///< [s]: two steps of the wearer
};

/// Options of a gear's play (backlash).
struct BacklashOptions {
  double noise = 0.035;  ///< [rad/s] of a demand: a slower turn does not change the flank
  /// [s] over which a crossing of the play is taken for a turn of the base, which it never was: gyro and
  /// encoder tell of it at different times. A slower turn would be answered by the next crossing, for ever.
  double crossing = 0.05;
};

/// Options for following a point that a tracker sees (target_track).
struct TargetTrackOptions {
  double forgotten = 0.5;    ///< [s]: after a longer gap the speed is another one
  double fold_time = 0.04;   ///< [s] over which sightings are averaged
  double speed_time = 0.15;  ///< [s] likewise for the speed, below a step of the wearer
};

/// Options of the places that a search looks at (search_plan).
struct SearchPlanOptions {
  double view_step = 0.75;  ///< of a view: the next one shows a part of it again
  double least_step = 0.1;  ///< [rad]
};

/// Options of the modes (pointer).
struct PointerOptions {
  double following = 1.0;  ///< [s]: a sway of the wearer at 1 Hz is a sixth of itself
  double on_target = 0.5 * std::numbers::pi / 180;  ///< [rad]
  double settling = 0.05;                           ///< [s] on the target until it is said
  double glance = 0.15;            ///< [s] at a place of a search: some images that are still
  double share_of_view = 1.0 / 6;  ///< so near to the middle of a place its image is as good
  /// [s] for a place at the edge, which a sway takes out of reach, from when the axes can be there.
  double patience = 1;
  /// How long a search knows what it has looked at while another mode is on, such as one that examines a
  /// likely place: that takes less. After longer the camera was found, or is another one's, and the likeliest
  /// place would be one that was looked at.
  std::chrono::milliseconds remembered{3000};
  /// [s] until a sample has come and a setpoint is with its drive, as frames of the bus take it, and the part
  /// of that until a sample has come.
  double on_the_wire = 0.002;
  double of_sample = 0.001;
  std::chrono::milliseconds gap{100};  ///< between samples: after it nobody knows how the base moved
  double furthest = 0.1;               ///< [s] that the motion of the base is foretold
};

struct RigTuning {
  AxisOptions axis;
  StallOptions stall;
  RigTimingOptions timing;
  AttitudeOptions attitude;
  BaseOptions base;
  BacklashOptions backlash;
  TargetTrackOptions target;
  SearchPlanOptions search;
  PointerOptions pointer;
};

/// Lists the options that an operator may set: all of them.
[[nodiscard]] OptionList list_options(RigTuning* tuning);

}  // namespace cairn
