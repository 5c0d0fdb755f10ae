// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <map>
#include <string>
#include <utility>

#include "common/base/log.h"
#include "common/base/rate_limit.h"
#include "common/base/time.h"
#include "server/access/principal.h"
#include "server/keys/site_keys.h"

namespace cairn {

/// Knows who speaks to the server: whose keys a partition is kept for by DDS Security in a secured site,
/// whoever speaks there in an open one. Turns away whose keys were revoked. The time is handed in; one
/// thread.
class Doorkeeper {
 public:
  /// Why somebody is turned away, for a person.
  static constexpr const char* kRevoked = "its keys were revoked";

  Doorkeeper(SiteKeys keys, Logger log) : keys_(std::move(keys)), log_(std::move(log)) {}

  /// By the name in a partition of theirs.
  [[nodiscard]] Principal client(std::string name) const;
  [[nodiscard]] Principal operator_of(std::string name);

  [[nodiscard]] bool is_turned_away(IdentityRole role, const std::string& name) const {
    return keys_.is_revoked(role, name);
  }
  /// Whether it is time to say (again) that somebody who was turned away goes on trying.
  [[nodiscard]] bool is_to_be_told(IdentityRole role, const std::string& name, MonotonicTime now);

  /// Whether somebody else may come in, or not any more. Does nothing before next_look().
  [[nodiscard]] bool look(MonotonicTime now);
  /// In an open site: never.
  [[nodiscard]] MonotonicTime next_look() const {
    return keys_.is_secured() ? next_look_ : MonotonicTime::max();
  }

 private:
  void read();

  SiteKeys keys_;
  Logger log_;
  MonotonicTime next_look_;
  bool is_changed_ = false;                                         ///< since look() said so
  std::map<std::pair<IdentityRole, std::string>, RateLimit> told_;  ///< of the register's revoked names
  RateLimit trouble_;
  RateLimit unknown_operator_;
};

}  // namespace cairn
