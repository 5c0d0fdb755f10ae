// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <utility>

#include "server/service/clients.h"
#include "server/service/served_maps.h"

namespace cairn {

/// What clients are told of the maps: which there are for each of them, and what self-calibration in these
/// says of its cameras. Of a map that it may not read, a client hears nothing. Used from the service's
/// thread.
class MapNews {
 public:
  MapNews(const ServiceContext& context, const MapArray& maps, Clients& clients)
      : context_(context), maps_(maps), clients_(clients) {}
  MapNews(const MapNews&) = delete;
  MapNews& operator=(const MapNews&) = delete;

  /// Tells a client that has just come of all maps that it may read.
  void tell_newcomer(Client& client);
  /// Tells all connected clients that may read the map what it is called, and so on (MapInfo).
  void tell(MapId map, const MapEntry& entry);
  /// Notes that the map has another revision. Of its cameras clients are told at once, before the revision
  /// that names them; of the map itself with the next tell_due().
  void note_revised(MapId map, const MapEntry& entry);
  /// Tells all clients that the map is not there any more.
  void tell_gone(MapId map);
  /// Tells what has changed since it was told, and what could not be written.
  void tell_due();
  /// Follows a change of rights: what a client may no longer read is taken from it at once, and what it may
  /// read now is offered.
  void tell_by_rights(Client& client);

 private:
  void list(MapId map, const MapEntry& entry, Client& client);
  void unlist(MapId map, Client& client);
  void tell_cameras(MapId map, const MapEntry& entry);
  void tell_camera(std::pair<MapId, Epoch> where, const CameraEstimate& estimate, Client& client);
  void forget_cameras(MapId map, Client& client);

  const ServiceContext& context_;
  const MapArray& maps_;
  Clients& clients_;
  std::map<MapId, bool> info_due_;  ///< maps whose MapInfo has changed since it was told
};

}  // namespace cairn
