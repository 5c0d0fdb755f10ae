// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <utility>

#include "server/access/access_policy.h"
#include "server/access/rights.h"

namespace cairn {

/// What the rights of a site allow, at the time that the clock says. Used from one thread.
class RightsPolicy : public AccessPolicy {
 public:
  using Clock = std::function<Timestamp()>;  ///< the wall clock: grants expire by it
  RightsPolicy(Rights rights, Clock clock) : rights_(std::move(rights)), clock_(std::move(clock)) {}

  [[nodiscard]] Ruling in_map(const Principal& client, const MapId& map) const override {
    return rights_.rule(client.name, map, clock_());
  }
  [[nodiscard]] Ruling on_creating(const Principal& client) const override {
    return rights_.rule_on_creating(client.name);
  }
  [[nodiscard]] bool may_propose(const Principal& client, const MapId& map) const override {
    return rights_.welcomes_proposals(map) && may_read(client, map);
  }
  [[nodiscard]] std::string why_frozen(const MapId& map) const override { return rights_.why_frozen(map); }
  [[nodiscard]] std::string why_blocked(const Principal& client) const override {
    return rights_.why_blocked(client.name);
  }
  /// Whether the operator's role allows the act. Error kRefused: it does not.
  [[nodiscard]] Status may_ask(const Principal& who, OperatorAct act) const override {
    const Duty needed = duty_for(act);
    if (who.duty >= needed) return {};
    return fail(ErrorCode::kRefused, "operator " + who.name + " has the role " +
                                         std::string(to_string(who.duty)) + "; this needs the role " +
                                         std::string(to_string(needed)));
  }

  [[nodiscard]] const Rights& rights() const { return rights_; }
  /// Sets the rights that hold from now on.
  void put(Rights rights) { rights_ = std::move(rights); }
  [[nodiscard]] Timestamp now() const { return clock_(); }

 private:
  Rights rights_;
  Clock clock_;
};

}  // namespace cairn
