// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "server/store/map_file.h"

namespace cairn {

/// How many ids of an earlier epoch of the map mean the same in the present one. Nothing: the epoch is not
/// known. Pure.
[[nodiscard]] std::optional<EpochRecord> ids_in_common(std::span<const EpochRecord> epochs, Epoch earlier,
                                                       Epoch present);

}  // namespace cairn
