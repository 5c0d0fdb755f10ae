// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "common/wire/participant.h"
#include "hw/app/simulated_rig.h"

namespace cairn {

enum class RigTask : uint8_t { kRun, kDoctor, kSimulate, kCalibrate };

/// The words of `cairn-rig`, checked.
struct RigOptions {
  RigTask task = RigTask::kRun;
  std::string can;             ///< interface; empty: none, devices and rig in one process
  std::string config;          ///< file
  bool prints_config = false;  ///< the rig that the file describes is printed, and nothing else is done
  std::string camera;          ///< of simulated devices: socket that tells where it is; empty: none
  std::string name;            ///< empty: that of the keys, or of the file
  wire::ParticipantOptions network;
  std::vector<TimedFault> faults;
  uint32_t seed = 1;
  int time_scale = 1;
  bool agreed = false;  ///< calibrate: the axes may move without a question
  int verbosity = 0;    ///< as make_logger()
};

/// The words, or the exit code of a process that is to end now, which has said why.
[[nodiscard]] std::variant<RigOptions, int> parse_rig_options(int argc, const char* const* argv);

}  // namespace cairn
