// SPDX-License-Identifier: Apache-2.0
#include "common/wire/partition.h"

namespace cairn::wire {
namespace {

constexpr std::string_view kClientPrefix = "client.";
constexpr std::string_view kOperatorPrefix = "operator.";
constexpr std::string_view kRigPrefix = "rig.";
constexpr std::string_view kWearerPrefix = "wearer.";
constexpr std::string_view kMapInfix = ".map.";

}  // namespace

std::string client_partition(std::string_view name) {
  return std::string(kClientPrefix).append(name);
}

std::string operator_partition(std::string_view name) {
  return std::string(kOperatorPrefix).append(name);
}

std::string rig_partition(std::string_view name) {
  return std::string(kRigPrefix).append(name);
}

std::string wearer_partition(std::string_view name) {
  return std::string(kWearerPrefix).append(name);
}

std::optional<std::string> parse_operator_partition(std::string_view partition) {
  if (!partition.starts_with(kOperatorPrefix)) return std::nullopt;
  partition.remove_prefix(kOperatorPrefix.size());
  return is_valid_name(partition) ? std::optional(std::string(partition)) : std::nullopt;
}

std::string map_partition(std::string_view name, const MapId& map) {
  return client_partition(name).append(kMapInfix).append(to_hex(map.bytes));
}

std::optional<PartitionIdentity> parse_partition(std::string_view partition) {
  if (!partition.starts_with(kClientPrefix)) return std::nullopt;
  partition.remove_prefix(kClientPrefix.size());
  const size_t infix = partition.find(kMapInfix);  // a name holds no dot
  const std::string_view name = partition.substr(0, infix);
  if (!is_valid_name(name)) return std::nullopt;
  PartitionIdentity identity{std::string(name), std::nullopt};
  if (infix != std::string_view::npos) {
    const auto bytes = from_hex(partition.substr(infix + kMapInfix.size()));
    if (!bytes) return std::nullopt;
    identity.map = MapId{*bytes};
  }
  return identity;
}

}  // namespace cairn::wire
