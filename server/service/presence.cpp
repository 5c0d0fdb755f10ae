// SPDX-License-Identifier: Apache-2.0
#include "server/service/presence.h"

#include <algorithm>

namespace cairn {

Presence::Standing Presence::heard(const std::string& name, SessionId session,
                                   wire::PublicationHandle publication, MonotonicTime now) {
  const Holder speaker{session, publication, now};
  const auto [it, is_new] = holders_.try_emplace(name, speaker);
  if (is_new) return Standing::kNewHolder;
  Holder& holder = it->second;
  const bool same_process = holder.session == session || holder.publication == publication;
  if (!same_process && now - holder.last_heard < kSilence) return Standing::kIntruder;
  const bool same_session = holder.session == session;
  holder = speaker;
  return same_session ? Standing::kHolder : Standing::kNewHolder;
}

bool Presence::holds(const std::string& name, SessionId session) const {
  const auto it = holders_.find(name);
  return it != holders_.end() && it->second.session == session;
}

bool Presence::is_holder(const std::string& name, wire::PublicationHandle publication) const {
  const auto it = holders_.find(name);
  return it != holders_.end() && it->second.publication == publication;
}

int Presence::live_count(MonotonicTime now) const {
  return static_cast<int>(std::count_if(holders_.begin(), holders_.end(), [now](const auto& entry) {
    return now - entry.second.last_heard < kSilence;
  }));
}

}  // namespace cairn
