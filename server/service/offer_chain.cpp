// SPDX-License-Identifier: Apache-2.0
#include "server/service/offer_chain.h"

#include <algorithm>

namespace cairn {

void OfferChain::put(const std::string& client, SessionId session, uint64_t command, const Link& link) {
  if (clients_.size() >= kMostClients && !clients_.contains(client)) {
    clients_.erase(std::min_element(clients_.begin(), clients_.end(), [](const auto& a, const auto& b) {
      return a.second.last_put < b.second.last_put;
    }));
  }
  Session& known = clients_[client];
  if (known.session != session) known = {session, {}, 0};
  known.last_put = ++puts_;
  known.links.insert_or_assign(command, link);
  if (known.links.size() > kRemembered) known.links.erase(known.links.begin());
}

const OfferChain::Link* OfferChain::find(const std::string& client, SessionId session,
                                         uint64_t command) const {
  const auto known = clients_.find(client);
  if (known == clients_.end() || known->second.session != session) return nullptr;
  const auto link = known->second.links.find(command);
  return link == known->second.links.end() ? nullptr : &link->second;
}

}  // namespace cairn
