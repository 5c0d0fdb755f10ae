// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

#include "common/base/option_list.h"

namespace cairn {

/// The times of RigCommander, by the stamps of frames and of the rig's states, whose clock may be a slowed
/// one; `gone` and `longest_gap` by this process's clock.
struct CommanderOptions {
  /// How long the camera is lost before the rig searches: a blurred image or a hand is soon over.
  std::chrono::milliseconds search_after{300};
  /// How long the camera stays turned to a place where it may be found while it is lost, counted in stamps of
  /// frames: from the first frame that comes after the order to turn there, or from the latest in which a
  /// pose was being verified. The turn itself counts, too.
  std::chrono::milliseconds candidate_time{400};
  std::chrono::milliseconds kept{3000};  ///< for which directions are remembered
  std::chrono::milliseconds near{50};    ///< between the stamps of a frame and of a direction, at most
  std::chrono::milliseconds anew{1000};  ///< until an order that was refused or given up is given again
  std::chrono::milliseconds gone{1000};  ///< of silence, after which the rig is not there,
  int missed_states = 10;                ///< and no fewer states than that, of a rig whose clock is slowed
  std::chrono::milliseconds longest_gap{1000};  ///< between two of them
  std::chrono::milliseconds turned{3000};       ///< after homing, to look ahead, at most
};

/// Lists the options that an operator may set: all of them.
[[nodiscard]] OptionList list_options(CommanderOptions* options);

}  // namespace cairn
