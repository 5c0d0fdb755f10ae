// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "common/wire/messages.h"
#include "server/service/map_array.h"
#include "server/store/store.h"

/// What operators are answered (idl/README.md, AdminReply). Pure.
namespace cairn {

/// Of a map that is served, that is, has a snapshot.
[[nodiscard]] nlohmann::json describe(MapId id, const MapEntry& entry);
[[nodiscard]] nlohmann::json describe(const DeletedMap& map);

[[nodiscard]] wire::AdminReply refusal(const Error& error);
[[nodiscard]] wire::AdminReply refusal(ErrorCode code, std::string message);
[[nodiscard]] wire::AdminReply success(const nlohmann::json& content);

}  // namespace cairn
