// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

#include "common/base/option_list.h"

namespace cairn {

/// The times of RigCommander, by the rig's clock.
struct CommanderOptions {
  /// How long the camera is lost before the rig searches: a blurred image or a hand is soon over.
  std::chrono::milliseconds search_after{300};
  /// How long the camera looks at a place that may be it, from the first frame after the place was told, or
  /// from the latest one in which a pose was being verified.
  std::chrono::milliseconds candidate_time{400};
  std::chrono::milliseconds kept{3000};  ///< for which directions are remembered
  std::chrono::milliseconds near{50};    ///< between stamps of a frame and of a direction
  std::chrono::milliseconds anew{1000};  ///< until an order that was refused or given up is given again
  std::chrono::milliseconds gone{1000};  ///< of silence, after which the rig is not there,
  int missed_states = 10;                ///< and no fewer states than that, of a rig whose clock is slowed
  std::chrono::milliseconds longest_gap{1000};  ///< between two of them
  std::chrono::milliseconds turned{3000};       ///< after homing, to look ahead
};

/// Lists the options that an operator may set: all of them.
[[nodiscard]] OptionList list_options(CommanderOptions* options);

}  // namespace cairn
