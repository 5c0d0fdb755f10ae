// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/service/admin_request.h"
#include "server/service/health.h"
#include "server/service/operator_answer.h"
#include "server/service/places.h"

namespace cairn {

/// Describes a map that is served, that is, has a snapshot.
[[nodiscard]] told::Map describe_map(MapId id, const MapEntry& entry);

/// What operators see: the server, its maps, who is there. Changes nothing. Used from the service's thread.
class Overview {
 public:
  Overview(const ServiceContext& context, const MapArray& maps, const Clients& clients,
           const Sessions& sessions, const Places& places, Health& health)
      : context_(context),
        maps_(maps),
        clients_(clients),
        sessions_(sessions),
        places_(places),
        health_(health) {}
  Overview(const Overview&) = delete;
  Overview& operator=(const Overview&) = delete;

  [[nodiscard]] told::Server server() const;
  [[nodiscard]] told::Clients clients() const;
  /// A map that is served.
  [[nodiscard]] told::BusyMap describe(MapId id, const MapEntry& entry) const;
  /// A page of all maps: those that are served, deleted, damaged, and could not be loaded.
  void list(const asked::Maps& begin, const AdminAnswer& answer);
  /// Answers with a map, and with measures that take a look at all of it.
  void show(MapId id, const MapEntry& entry, const AdminAnswer& answer) const;
  /// Number of trackers that are found in a map now.
  [[nodiscard]] size_t count_in(MapId map) const;

 private:
  const ServiceContext& context_;
  const MapArray& maps_;
  const Clients& clients_;
  const Sessions& sessions_;
  const Places& places_;
  Health& health_;
};

}  // namespace cairn
