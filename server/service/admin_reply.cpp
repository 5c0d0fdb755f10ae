// SPDX-License-Identifier: Apache-2.0
#include "server/service/admin_reply.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "server/service/one_line.h"

namespace cairn {

using nlohmann::json;

json describe(MapId id, const MapEntry& entry) {
  json map{{"id", to_hex(id.bytes)},
           {"name", entry.name},
           {"keyframes", entry.snapshot->keyframe_count()},
           {"points", entry.snapshot->point_count()},
           {"epoch", entry.snapshot->epoch.value},
           {"revision", entry.snapshot->revision.value},
           {"memory_bytes", bytes_of(entry)},
           {"plane_aligned", entry.plane_aligned}};
  if (!entry.frozen.empty()) map["frozen"] = entry.frozen;
  return map;
}

json describe(const DeletedMap& map) {
  return {{"id", to_hex(map.header.id.bytes)},
          {"name", map.header.name},
          {"deleted", map.deleted.nanoseconds},
          {"bytes", map.bytes}};
}

wire::AdminReply refusal(const Error& error) {
  wire::AdminReply reply;
  // Whatever else it is to us, to the operator it is the server's no.
  const bool own_words = error.code == ErrorCode::kUsage || error.code == ErrorCode::kDamaged;
  reply.result = static_cast<uint8_t>(exit_code(own_words ? error.code : ErrorCode::kRefused));
  reply.text = one_line(error.message);
  return reply;
}

wire::AdminReply refusal(ErrorCode code, std::string message) {
  return refusal(Error{code, std::move(message)});
}

wire::AdminReply success(const json& content) {
  wire::AdminReply reply;
  // A path in it may be no UTF-8.
  reply.text = content.dump(-1, ' ', false, json::error_handler_t::replace);
  return reply;
}

}  // namespace cairn
