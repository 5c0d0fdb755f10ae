// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "server/service/capacity.h"
#include "server/service/map_news.h"
#include "server/service/proposals.h"
#include "server/service/sessions.h"

namespace cairn {

/// Seeds and offers, on their way to the queue of a map and back: each is judged once, within the credit of
/// its client, and its client is told. Used from the service's thread.
class Commands {
 public:
  Commands(const ServiceContext& context, Clients& clients, Sessions& sessions, ServedMaps& maps,
           const Capacity& capacity, MapNews& news, Proposals& proposals)
      : context_(context),
        clients_(clients),
        sessions_(sessions),
        maps_(maps),
        capacity_(capacity),
        news_(news),
        proposals_(proposals) {}
  Commands(const Commands&) = delete;
  Commands& operator=(const Commands&) = delete;

  /// Takes a seed or an offer of the process that holds the client's name; those of others are passed over.
  void take(const Principal& who, wire::MapSeed message);
  void take(const Principal& who, wire::KeyframeOffer message);

 private:
  using Refusal = std::optional<std::pair<wire::OfferDecision, std::string>>;

  using Pending = std::shared_ptr<const PendingOffer>;
  /// Why no map is made for the client, which may make some; empty: one may be.
  [[nodiscard]] std::string why_no_map(const Client& client) const;
  void tell_no_map(const std::string& client_name, const std::string& why);
  void make_map(Client& client, const AnnouncedCamera& camera, const Ruling& ruling, wire::MapSeed message,
                wire::SeedVerdict verdict);
  void on_seed_judged(const std::string& client_name, const wire::SeedVerdict& verdict,
                      const Result<SeedResult>& result, const MapSnapshotPtr& snapshot,
                      const Pending& pending);
  void let_maker_write(const std::string& client_name, MapId map, const std::function<void()>& then);
  /// Removes a map that is in the store by now, and of which nobody has been told.
  void take_out(MapId map);
  void on_seed_decided(const std::string& client_name, wire::SeedVerdict verdict,
                       const Result<SeedResult>& result, const MapSnapshotPtr& snapshot);

  /// Passes an offer on to the map's queue, aside, or back to the client.
  void pass_on(Client& client, const AnnouncedCamera& camera, wire::KeyframeOffer message);
  /// Why an offer that is not set aside does not get to its map; nothing: it does.
  [[nodiscard]] Refusal refuse(const wire::KeyframeOffer& message, const MapEntry& entry,
                               const Ruling& ruling) const;
  void offer(const std::string& client_name, MapEntry* entry, OfferJob job, wire::OfferOutcome outcome);
  void on_offer_decided(const std::string& client_name, SessionId session, wire::OfferOutcome outcome);
  void note_refused_offer(Client& client, const MapEntry& entry, const std::string& why);

  const ServiceContext& context_;
  Clients& clients_;
  Sessions& sessions_;
  ServedMaps& maps_;
  const Capacity& capacity_;
  MapNews& news_;
  Proposals& proposals_;
};

}  // namespace cairn
