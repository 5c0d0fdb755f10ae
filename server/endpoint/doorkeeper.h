// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/base/log.h"
#include "common/base/rate_limit.h"
#include "common/base/time.h"
#include "common/wire/peers.h"
#include "common/wire/refused_peers.h"
#include "server/access/principal.h"
#include "server/access/rights.h"
#include "server/endpoint/refusals.h"
#include "server/endpoint/tries.h"
#include "server/keys/site_keys.h"

namespace cairn {

/// Knows who speaks to the server: whose keys a partition is kept for by DDS Security in a secured site,
/// whoever speaks there in an open one. Turns away whose keys were revoked. The time is handed in; one
/// thread.
class Doorkeeper {
 public:
  /// Why somebody is turned away, for a person.
  static constexpr const char* kRevoked = "its keys were revoked";
  /// Notice to a client that is turned away.
  static constexpr const char* kYoursRevoked =
      "an operator has revoked the keys of this device: it is not served any more; ask the operator for new "
      "ones";

  /// `refused`: whom the middleware has not let in; null: nobody says.
  Doorkeeper(SiteKeys keys, Logger log, std::shared_ptr<wire::RefusedPeers> refused = nullptr)
      : keys_(std::move(keys)), log_(std::move(log)), refusals_(std::move(refused)) {}

  /// The client or operator of that name, which is in the name of its partition. In a secured site, an
  /// operator that the register does not know gets the duty to watch, and no other.
  [[nodiscard]] Principal client(std::string name) const;
  [[nodiscard]] Principal operator_of(std::string name);

  /// The wearer of that client's camera: as its keys say in a secured site, as it claims in an open one.
  [[nodiscard]] std::string wearer_of(const std::string& client, const std::string& claimed) const {
    return keys_.is_secured() ? keys_.wearer_of(client) : claimed;
  }

  /// The clients that have keys, and the groups that these name; nothing in an open site.
  [[nodiscard]] std::optional<GroupsOfClients> groups_of_clients() const {
    return keys_.is_secured() ? std::optional(keys_.groups_of_clients()) : std::nullopt;
  }

  [[nodiscard]] bool is_turned_away(IdentityRole role, const std::string& name) const {
    return keys_.is_revoked(role, name);
  }
  /// Clients that are turned away whenever they come.
  [[nodiscard]] std::set<std::string> clients_turned_away() const {
    return keys_.revoked(IdentityRole::kClient);
  }
  /// Notes a try of somebody who is turned away. Returns why he is, for the log, if that is to be said
  /// (again).
  [[nodiscard]] std::optional<std::string> note_try(IdentityRole role, const std::string& name,
                                                    const std::optional<wire::PeerId>& process,
                                                    MonotonicTime now);

  /// Peers that come, are let in by the middleware, and go.
  void came(uint64_t participant, std::string says, MonotonicTime now) {
    if (keys_.is_secured()) refusals_.came(participant, std::move(says), now);
  }
  void is_let_in(uint64_t participant) { refusals_.is_let_in(participant); }
  void gone(uint64_t participant) { refusals_.gone(participant); }

  /// Whom the middleware has not let in, and of whom that is to be said (again): of few at a time.
  [[nodiscard]] std::vector<wire::RefusedPeer> refused_to_be_told(MonotonicTime now);

  /// Whether somebody else may come in, or not any more. Does nothing before next_look().
  [[nodiscard]] bool look(MonotonicTime now);
  /// Time of the next look at the register; in an open site never.
  [[nodiscard]] MonotonicTime next_look() const {
    return keys_.is_secured() ? next_look_ : MonotonicTime::max();
  }

 private:
  void read();

  SiteKeys keys_;
  Logger log_;
  MonotonicTime next_look_;
  bool is_changed_ = false;  ///< since look() said so
  Tries tries_;              ///< of the register's revoked names
  Refusals refusals_;
  RateLimit trouble_;
  RateLimit unknown_operator_;
};

}  // namespace cairn
