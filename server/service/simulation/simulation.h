// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/log.h"
#include "server/service/simulation/curator.h"

namespace cairn::simulation {

/// What came of one run.
struct Report {
  std::vector<std::string> violations;  ///< of what a server promises; empty: none
  size_t starts = 0;                    ///< of the server
  size_t kills = 0;                     ///< likewise
  size_t maps = 0;
  size_t revisions = 0;
  Curator::Done curated;
};

/// Clients, operators, the network, the disk and the server in one thread, all that chance decides by `seed`.
[[nodiscard]] Report run(uint64_t seed, const Logger& log);

}  // namespace cairn::simulation
