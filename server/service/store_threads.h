// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/service/map_persistence.h"

namespace cairn {

/// The threads that a server keeps its maps by: one that writes, and one beside it.
[[nodiscard]] MapPersistence::Runtime store_threads(const Logger& log);

}  // namespace cairn
