// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <utility>

#include "common/wire/messages.h"
#include "server/access/principal.h"

namespace cairn {

/// Queries that came at once: of each process the newest counts. Which process holds a name, others say: a
/// second one under it must not put its query in the place of the holder's.
class NewestQueries {
 public:
  void put(const Principal& who, wire::RelocQuery query) {
    newest_.insert_or_assign(std::pair(who.name, query.command.session), std::pair(who, std::move(query)));
  }
  template <typename Take>
  void hand_over(const Take& take) {
    for (auto& [process, asked] : newest_) take(asked.first, std::move(asked.second));
    newest_.clear();
  }

 private:
  std::map<std::pair<std::string, SessionId>, std::pair<Principal, wire::RelocQuery>> newest_;
};

}  // namespace cairn
