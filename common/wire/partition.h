// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "common/map/ids.h"

/// Partitions carry identity and rights. A client writes and reads in `client.<name>` and receives
/// a map in `client.<name>.map.<32 hex digits>`; with DDS Security on it can do neither in another's.
namespace cairn::wire {

/// The partitions in which the server hears clients: every client's. The '*' spans dots too, so it also
/// matches the map partitions; no topic that the server reads is written there.
constexpr std::string_view kEveryClient = "client.*";

/// `client.<name>`; the name is valid (is_valid_name).
[[nodiscard]] std::string client_partition(std::string_view name);
/// Where the server hears operators, and where one of them speaks and listens: `operator.<name>`.
constexpr std::string_view kEveryOperator = "operator.*";
[[nodiscard]] std::string operator_partition(std::string_view name);
/// Name of the operator whose partition it is; nothing for any other text.
[[nodiscard]] std::optional<std::string> parse_operator_partition(std::string_view partition);
/// Where the server hears rigs, and where one of them speaks: `rig.<name>`.
constexpr std::string_view kEveryRig = "rig.*";
[[nodiscard]] std::string rig_partition(std::string_view name);
/// Where somebody speaks to a rig, so that it knows who he is: a client in `rig.<rig>.client.<name>`, an
/// operator in `rig.<rig>.operator.<name>`; the rig reads in `rig.<rig>.*`.
[[nodiscard]] std::string client_to_rig_partition(std::string_view rig, std::string_view name);
[[nodiscard]] std::string operator_to_rig_partition(std::string_view rig, std::string_view name);
[[nodiscard]] std::string everybody_to_rig(std::string_view rig);
struct RigSpeaker {
  std::string rig;
  std::string name;
  bool is_operator = false;  ///< else a client
  bool operator==(const RigSpeaker&) const = default;
};
/// Inverse of the first two; nothing for any other text.
[[nodiscard]] std::optional<RigSpeaker> parse_rig_speaker(std::string_view partition);

/// Where the cameras of one wearer on one host speak and listen: `wearer.<name>`.
[[nodiscard]] std::string wearer_partition(std::string_view name);

/// `client.<name>.map.<map>`.
[[nodiscard]] std::string map_partition(std::string_view name, const MapId& map);

struct PartitionIdentity {
  std::string client;        ///< name
  std::optional<MapId> map;  ///< of a map partition
  bool operator==(const PartitionIdentity&) const = default;
};

/// Inverse of the two above; nothing for any other text, wildcards among them.
[[nodiscard]] std::optional<PartitionIdentity> parse_partition(std::string_view partition);

}  // namespace cairn::wire
