// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "common/base/result.h"
#include "server/mapping/map_maker.h"
#include "server/relocalization/relocalizer.h"
#include "server/service/service_options.h"
#include "server/service/wearer_rule.h"

namespace cairn {

/// Half of the machine's memory [MB].
[[nodiscard]] uint64_t half_of_memory_mb();

/// The command line of cairn-server merged with its configuration file; the command line wins.
struct ServerOptions {
  int domain = 0;
  std::string listen;  ///< interface or address; empty: by profile
  std::string profile = "loopback";
  uint64_t seed = 0;            ///< 0: ids are random
  MapMakerOptions mapping;      ///< --adjuster, and the constants of a configuration file
  RelocOptions relocalization;  ///< --relocalizer, likewise
  size_t max_maps = 1000;
  size_t max_maps_per_client = MapServiceOptions().max_maps_per_client;
  uint64_t max_memory_mb = half_of_memory_mb();  ///< of all maps together
  size_t max_keyframes = MapServiceOptions().max_keyframes;
  size_t max_labels = MapServiceOptions().max_labels;
  RateLimits rates;
  std::string store;                    ///< folder; empty: nothing is kept
  std::chrono::seconds idle_after{60};  ///< ServiceOptions::idle_after
  std::chrono::seconds drop_after{10};  ///< ServiceOptions::drop_after
  std::chrono::hours keep_deleted{0};   ///< ServiceOptions::keep_deleted
  bool lockstep = true;                 ///< ServiceOptions::lockstep
  WearerPolicy wearer_policy = WearerPolicy::kFirst;
  std::string security;  ///< folder of the server's keys; empty: an open site
  std::string stats;     ///< file; empty: none
  std::string wearers;   ///< file; empty: as clients claim
  int verbosity = 0;
};

/// The process is to end at once: with help on stdout (code 0) or a complaint on stderr.
struct EarlyExit {
  int code = 0;
  std::string text;
};

/// Reads `arguments` (without the program's name) and the file that --config names. With --print-config the
/// exit is the configuration so resolved, on stdout. Unknown options and keys are refused with the nearest
/// valid one named; what the contract has and this version not is refused only when used.
[[nodiscard]] std::variant<ServerOptions, EarlyExit> parse_server_options(std::vector<std::string> arguments);

}  // namespace cairn
