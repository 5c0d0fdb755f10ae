// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <string>

#include "server/service/admin_request.h"
#include "server/service/labels.h"
#include "server/service/map_administration.h"

namespace cairn {

/// Versions of a map: tags, roll-backs, copies, and who has contributed to it. What is in the file is done by
/// the store's writer, in its turn: behind all that the map has handed in. Used from the service's thread.
class MapVersions {
 public:
  MapVersions(const ServiceContext& context, ServedMaps& maps, Labels& labels, const Capacity& capacity,
              MapAdministration& administration, const Overview& overview)
      : context_(context),
        maps_(maps),
        labels_(labels),
        capacity_(capacity),
        administration_(administration),
        overview_(overview) {}
  MapVersions(const MapVersions&) = delete;
  MapVersions& operator=(const MapVersions&) = delete;

  void take(const std::string& operator_name, MapId id, MapEntry* entry, const asked::OfVersions& ask,
            const AdminAnswer& answer);
  /// Maps that have little room left but for what was removed from them, and that nobody uses, give that up
  /// (compact_map.h). With a store only.
  void compact_crowded(MonotonicTime now);

 private:
  /// The map that is meant: it is served, and nothing is under way with it.
  struct Meant {
    MapId id;
    MapEntry* entry;
    std::string author;  ///< who asks
  };
  void take(const Meant& map, const asked::Tag& ask, const AdminAnswer& answer);
  void take(const Meant& map, const asked::Untag& ask, const AdminAnswer& answer);
  void take(const Meant& map, const asked::Tags& ask, const AdminAnswer& answer);
  void take(const Meant& map, const asked::RollBack& ask, const AdminAnswer& answer);
  void take(const Meant& map, const asked::Copy& ask, const AdminAnswer& answer);
  void take(const Meant& map, const asked::Contributors& ask, const AdminAnswer& answer);
  void take(const Meant& map, const asked::DropContributor& ask, const AdminAnswer& answer);
  /// A tag of the map as it is now.
  [[nodiscard]] MapTag tag_now(const Meant& map, const std::string& name) const;
  /// Why there is no room for what was tagged; empty where there is.
  [[nodiscard]] std::string why_tag_is_too_large(const MapEntry& entry, const MapTag& tag) const;
  /// Changes a map's file to another state, which is served in a new epoch then. On an error nothing has
  /// changed. Called beside the writer.
  using ChangeOfState = std::function<Status(Store& store, const AcceptState& accept)>;
  void change_state(MapId id, ChangeOfState change, const AdminAnswer& answer);
  void change_state_in_place(MapId id, MapEntry* entry, ChangeOfState change, HeldStrand::Hold place,
                             const AdminAnswer& answer);
  void replace(ResumedMap map, const AdminAnswer& answer);
  /// Whether nobody is in the map, and it has neither changed nor been offered a keyframe for so long
  /// (MapServiceOptions::compact_after) that no client is likely to keep an offer for it.
  [[nodiscard]] bool is_unused(MapId id, const MapEntry& entry) const;
  void compact(MapId id, const std::string& name);

  const ServiceContext& context_;
  ServedMaps& maps_;
  Labels& labels_;
  const Capacity& capacity_;
  MapAdministration& administration_;
  const Overview& overview_;
  std::map<MapId, MonotonicTime>
      compaction_tried_at_;  ///< last, of those that it has failed for or is on its way
};

}  // namespace cairn
