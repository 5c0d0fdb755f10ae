// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_news.h"

#include "server/service/proposal_rule.h"

namespace cairn {

void MapNews::tell_newcomer(Client& client) {
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.snapshot) list(map, entry, client);
  }
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.snapshot) tell_cameras(map, entry);
  }
}

void MapNews::tell(MapId map, const MapEntry& entry) {
  info_due_.erase(map);
  for (auto& [name, client] : clients_.all()) list(map, entry, client);
}

void MapNews::note_revised(MapId map, const MapEntry& entry) {
  info_due_[map] = true;
  tell_cameras(map, entry);
}

void MapNews::tell_gone(MapId map) {
  info_due_.erase(map);
  for (auto& [name, client] : clients_.all()) unlist(map, client);
}

void MapNews::tell_due() {
  // Revisions that name what could not be written are waited for in vain, and an idle map makes no more.
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.snapshot) tell_cameras(map, entry);
  }
  for (const auto& [map, due] : std::exchange(info_due_, {})) {
    if (const auto found = maps_.all().find(map); found != maps_.all().end()) tell(map, found->second);
  }
}

void MapNews::tell_by_rights(Client& client) {
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.snapshot == nullptr) continue;
    if (context_.access().may_read(client.principal(), map)) {
      list(map, entry, client);
      if (client.connected) tell_cameras(map, entry);
    } else {
      unlist(map, client);
    }
  }
}

void MapNews::list(MapId map, const MapEntry& entry, Client& client) {
  if (!client.connected) return;
  const Right right = context_.access().in_map(client.principal(), map).right;
  if (right < Right::kRead) return;
  client.maps_told.insert(map);
  wire::MapInfo info = make_map_info(context_.options.server, map, entry, right);
  info.takes_proposals = takes_proposals(context_, client, map, entry);
  clients_.tell(client, info);
}

/// A map that it was never told of is not named to it now.
void MapNews::unlist(MapId map, Client& client) {
  const bool was_listed = client.maps_told.erase(map) > 0;
  clients_.tell(client, MapUnlisted{map, was_listed});
  forget_cameras(map, client);
}

void MapNews::tell_cameras(MapId map, const MapEntry& entry) {
  for (const CameraEstimate& estimate : entry.statistics.cameras) {
    Client* client = clients_.find(estimate.version.client);
    if (client != nullptr && client->connected && context_.access().may_read(client->principal(), map))
      tell_camera({map, entry.snapshot->epoch}, estimate, *client);
  }
}

void MapNews::tell_camera(std::pair<MapId, Epoch> where, const CameraEstimate& estimate, Client& client) {
  const auto& [map, epoch] = where;
  const CameraVersion& version = estimate.version;
  const std::pair now(epoch, version.version);
  auto& told = client.cameras_told[{map, version.camera}];
  if (told == now) return;
  const CameraParameters& parameters = estimate.camera->parameters();
  const Status written = clients_.try_to_tell(
      client, wire::CameraEstimate{version.client, version.camera, map, epoch, version.version, parameters,
                                   sigma_of_values({parameters, estimate.sigma[0], estimate.sigma[1]}),
                                   estimate.frozen, estimate.cannot_be_known});
  if (written) told = now;  // else with the next tick
}

void MapNews::forget_cameras(MapId map, Client& client) {
  for (auto told = client.cameras_told.lower_bound({map, 0});
       told != client.cameras_told.end() && told->first.first == map;
       told = client.cameras_told.erase(told)) {
    clients_.tell(client, EstimateDropped{client.id, told->first.second, map});
  }
}

}  // namespace cairn
