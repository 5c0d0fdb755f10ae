// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "server/service/admin_reply.h"
#include "server/service/admin_request.h"
#include "server/service/health.h"
#include "server/service/places.h"

namespace cairn {

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

  [[nodiscard]] wire::AdminReply server() const;
  [[nodiscard]] wire::AdminReply clients() const;
  /// A map that is served.
  [[nodiscard]] nlohmann::json describe(MapId id, const MapEntry& entry) const;
  /// A page of all maps: those that are served, deleted, damaged, and could not be loaded.
  void list(const asked::Maps& begin, const AdminAnswer& answer);
  /// With what takes a look at all of the map.
  void show(MapId id, const MapEntry& entry, const AdminAnswer& answer) const;

 private:
  /// How many trackers are found in a map now.
  [[nodiscard]] size_t count_in(MapId map) const;

  const ServiceContext& context_;
  const MapArray& maps_;
  const Clients& clients_;
  const Sessions& sessions_;
  const Places& places_;
  Health& health_;
};

}  // namespace cairn
