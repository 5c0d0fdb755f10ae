// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string_view>
#include <variant>
#include <vector>

#include "common/base/time.h"
#include "hw/rig/kinematics.h"

namespace cairn {

/// The modes of pointing: what the camera is to look at. Directions are of the rig's world, in which the
/// attitude is told (z up), and of any length above 0.
namespace pointing {
/// Ahead, as the configuration says.
struct Neutral {
  PanTilt angles;
};
/// By hand: the axes turn at these rates.
struct Jog {
  PanTilt rates;  ///< [rad/s]
};
/// Ahead of the wearer as the wearer slowly turns, as far above the horizon as tilt's neutral angle.
struct Follow {};
/// A fixed direction; without one, that in which the camera looks when it begins.
struct Lock {
  std::optional<Eigen::Vector3d> direction;
};
/// A point of the world, wherever the wearer walks: that of the newest Sighting. Until there is one, and when
/// they end, it holds the direction.
struct Fixate {};
/// The camera turns to another direction as fast as the axes can, and is then locked on it.
struct Saccade {
  std::optional<Eigen::Vector3d> direction;
  PanTilt angles;  ///< without a direction, to that in which these look when it begins
};
/// The camera looks all around within reach, a glance at each place, first at those where the map may be.
/// What was looked at is remembered when the search goes on after another mode, for three seconds; a
/// direction that is newly ranked is looked at again.
struct Search {
  enum class Pattern : uint8_t { kSpiral, kRaster };
  Pattern pattern = Pattern::kSpiral;
  PanTilt view{0.9, 0.7};               ///< how much the camera sees, across and upright [rad]
  std::vector<Eigen::Vector3d> ranked;  ///< the likeliest first
};
}  // namespace pointing
using Pointing = std::variant<pointing::Neutral, pointing::Jog, pointing::Follow, pointing::Lock,
                              pointing::Fixate, pointing::Saccade, pointing::Search>;

/// The modes as words, in the order of Pointing.
enum class PointingMode : uint8_t { kNeutral, kJog, kFollow, kLock, kFixate, kSaccade, kSearch };
[[nodiscard]] PointingMode mode_of(const Pointing& pointing);
/// "neutral", "jog", ...
[[nodiscard]] const char* to_string(PointingMode mode);
[[nodiscard]] std::optional<PointingMode> pointing_mode(std::string_view word);

/// The place of the point to fixate, as a camera saw it.
struct Sighting {
  MonotonicTime when;      ///< when the image was taken, by the camera's clock
  Eigen::Vector3d target;  ///< in the camera (x right, y down, z forward), [m]; of another unit, the wearer's
                           ///< steps are foretold worse
};

/// How a mode goes.
struct PointingState {
  PointingMode mode = PointingMode::kNeutral;
  /// Whether the camera, by the IMU, has been near the target for some time (PointerOptions): within half a
  /// degree, in a search within a sixth of a view.
  bool on_target = false;
  bool out_of_reach = false;  ///< the target is beyond the soft limits
  bool sees_target = false;   ///< fixate: sightings come
  double looked_at = 0;       ///< search: share of the places within reach, of the present round
  int rounds = 0;             ///< search: how often all of them were looked at
};

}  // namespace cairn
