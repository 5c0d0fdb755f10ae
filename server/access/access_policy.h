// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/base/result.h"
#include "common/map/ids.h"
#include "common/map/map_set.h"
#include "server/access/principal.h"
#include "server/access/rights.h"

namespace cairn {

/// What an operator's request does.
enum class OperatorAct : uint8_t {
  kSee,       ///< lists and shows
  kChange,    ///< renames, freezes, deletes, undeletes and purges maps, changes labels
  kTransfer,  ///< takes a map out as an archive or brings one in: images leave the server
  kExamine,   ///< has all of the store read, which takes the server's disk for minutes
  kGovern,    ///< says who may do what
};

/// The least that an operator's role must be.
[[nodiscard]] constexpr Duty duty_for(OperatorAct act) {
  if (act == OperatorAct::kSee) return Duty::kWatch;
  return act == OperatorAct::kGovern ? Duty::kAdminister : Duty::kCurate;
}

/// The one place where it is asked who may do what. The map service asks before each request is carried out,
/// and before a map is listed, searched, answered or sent. Used from one thread, the service's.
class AccessPolicy {
 public:
  virtual ~AccessPolicy() = default;

  /// What a client may do with a map that there is.
  [[nodiscard]] virtual Ruling in_map(const Principal& client, const MapId& map) const = 0;
  /// Whether it may make maps: kWrite or kNone. Its extent bounds the map that is made.
  [[nodiscard]] virtual Ruling on_creating(const Principal& client) const = 0;
  /// Maps among `served` in which the client may find itself: the bounds of a search, and of its rivals.
  [[nodiscard]] virtual MapSet readable(const Principal& client, std::span<const MapId> served) const {
    std::vector<MapId> maps;
    std::ranges::copy_if(served, std::back_inserter(maps),
                         [&](const MapId& map) { return may_read(client, map); });
    return MapSet(std::move(maps));
  }
  /// Whether a keyframe that the client may not add to the map, or does not want to, is kept aside as a
  /// proposal.
  [[nodiscard]] virtual bool may_propose(const Principal& /*client*/, const MapId& /*map*/) const {
    return false;
  }
  /// Why the map takes no keyframes, proposals that an operator accepts included; empty: it does.
  [[nodiscard]] virtual std::string why_frozen(const MapId& /*map*/) const { return {}; }
  /// Why the client is kept out altogether, for its user; empty: it is not.
  [[nodiscard]] virtual std::string why_blocked(const Principal& /*client*/) const { return {}; }
  /// Error kRefused with the reason.
  [[nodiscard]] virtual Status may_ask(const Principal& operator_, OperatorAct act) const = 0;

  [[nodiscard]] bool may_read(const Principal& client, const MapId& map) const {
    return in_map(client, map).right >= Right::kRead;
  }
};

/// Everybody may do everything: of a site that has no rights.
class OpenAccess : public AccessPolicy {
 public:
  [[nodiscard]] Ruling in_map(const Principal&, const MapId&) const override {
    return {Right::kWrite, {}, {}, {}};
  }
  [[nodiscard]] Ruling on_creating(const Principal&) const override { return {Right::kWrite, {}, {}, {}}; }
  [[nodiscard]] MapSet readable(const Principal&, std::span<const MapId>) const override {
    return MapSet::all();
  }
  [[nodiscard]] Status may_ask(const Principal&, OperatorAct) const override { return {}; }
};

}  // namespace cairn
