// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "server/service/capacity.h"
#include "server/service/map_news.h"
#include "server/service/overview.h"

namespace cairn {

/// Refusal of requests about a map that is fed from outside.
inline constexpr const char* kMadeElsewhere = "this map is made elsewhere";

/// What operators do to maps: they are called otherwise, deleted, put back, and removed for good. The store's
/// part is done beside its writer. Used from the service's thread, unless said otherwise.
class MapAdministration {
 public:
  MapAdministration(const ServiceContext& context, ServedMaps& maps, MapNews& news, const Capacity& capacity,
                    Places& places, Health& health, const Overview& overview)
      : context_(context),
        maps_(maps),
        news_(news),
        capacity_(capacity),
        places_(places),
        health_(health),
        overview_(overview) {}
  MapAdministration(const MapAdministration&) = delete;
  MapAdministration& operator=(const MapAdministration&) = delete;

  void rename(MapId id, MapEntry* entry, const std::string& name, const AdminAnswer& answer);
  /// `for_good`: it cannot be had back, since nothing is kept.
  void remove(MapId id, MapEntry* entry, bool for_good, const AdminAnswer& answer);
  void undelete(const std::string& wanted, const AdminAnswer& answer);
  void purge(const std::string& wanted, const AdminAnswer& answer);
  /// Answers a request about a map that is not in service: one that is deleted is told from one that nobody
  /// knows.
  void answer_without_map(const std::string& verb, const std::string& wanted, const AdminAnswer& answer);

  /// Deletes what nobody will miss (YoungMaps), as an operator would.
  void drop_dead(MonotonicTime now);
  /// Purges what was deleted long ago. With a store only.
  void purge_old();
  /// Puts a map into service that has just come (back) into the store. To be called beside the writer
  /// (run_on_strand()). `undo` takes the map out again if it cannot be served, or if a name that it needs
  /// cannot be kept.
  void take_in(MapId id, MapOpening::Undo undo, const AdminAnswer& answer);

 private:
  /// `removed`: whether the store has let go of it; if not, it stays in service.
  void finish_removal(MapId id, const Status& removed, const AdminAnswer& answer);
  /// While others are served, under a name that is free; the answer follows when that is kept.
  void serve_anew(ResumedMap map, MapOpening::Undo undo, const AdminAnswer& answer);

  const ServiceContext& context_;
  ServedMaps& maps_;
  MapNews& news_;
  const Capacity& capacity_;
  Places& places_;
  Health& health_;
  const Overview& overview_;
};

}  // namespace cairn
