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

std::string client_to_rig_partition(std::string_view rig, std::string_view name) {
  return rig_partition(rig).append(".").append(client_partition(name));
}

std::string operator_to_rig_partition(std::string_view rig, std::string_view name) {
  return rig_partition(rig).append(".").append(operator_partition(name));
}

std::string everybody_to_rig(std::string_view rig) {
  return rig_partition(rig).append(".*");
}

std::optional<RigSpeaker> parse_rig_speaker(std::string_view partition) {
  if (!partition.starts_with(kRigPrefix)) return std::nullopt;
  partition.remove_prefix(kRigPrefix.size());
  const size_t dot = partition.find('.');  // a name holds none
  if (dot == std::string_view::npos || !is_valid_name(partition.substr(0, dot))) return std::nullopt;
  RigSpeaker speaker{std::string(partition.substr(0, dot)), {}, false};
  const std::string_view who = partition.substr(dot + 1);
  if (auto operator_name = parse_operator_partition(who)) {
    speaker.name = *std::move(operator_name);
    speaker.is_operator = true;
    return speaker;
  }
  auto client = parse_partition(who);
  if (!client || client->map) return std::nullopt;
  speaker.name = std::move(client->client);
  return speaker;
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
