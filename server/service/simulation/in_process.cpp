// SPDX-License-Identifier: Apache-2.0
#include "server/service/simulation/in_process.h"

namespace cairn::simulation {

void InProcess::connect(const std::string& client) {
  links_[client].is_connected = true;
  service_->clients().connect(client_principal(client));
}

void InProcess::disconnect(const std::string& client) {
  links_.erase(client);
  service_->clients().disconnect(client_principal(client));
}

void InProcess::want(const std::string& client, MapId map) {
  Link& link = links_[client];
  link.wanted.insert(map);
  open_feeds(client, &link);
}

void InProcess::want_no_more(const std::string& client, MapId map) {
  Link& link = links_[client];
  link.wanted.erase(map);
  link.fed.erase(map);
}

void InProcess::open_feeds(const std::string& client, Link* link) {
  for (const MapId map : link->wanted) {
    if (link->fed.contains(map)) continue;
    const auto followed = service_->maps().follow(client_principal(client), map);
    if (!followed) continue;
    link->fed.insert(map);
    listener_.delivered(client, followed->newest);
    for (const wire::LabelMessage& label : followed->labels) listener_.delivered(client, label);
  }
}

Status InProcess::tell(const std::string& client, const ClientEvent& event) {
  const auto link = links_.find(client);
  if (link == links_.end()) return {};
  const auto* gone = std::get_if<MapUnlisted>(&event);
  if (gone != nullptr) link->second.fed.erase(gone->map);
  if (!link->second.is_connected || (gone != nullptr && !gone->was_listed)) return {};
  listener_.delivered(client, event);
  if (std::holds_alternative<wire::MapInfo>(event)) open_feeds(client, &link->second);
  return {};
}

Status InProcess::answer(const std::string& operator_name, const wire::AdminReply& reply) {
  listener_.answered(operator_name, reply);
  return {};
}

void InProcess::revised(MapId map, const MapSnapshotPtr& newest) {
  listener_.revised(map, newest);
  for (auto& [name, link] : links_) {
    if (link.fed.contains(map)) {
      listener_.delivered(name, newest);
    } else if (link.wanted.contains(map)) {
      open_feeds(name, &link);
    }
  }
}

void InProcess::labelled(const wire::LabelMessage& label) {
  for (const auto& [name, link] : links_) {
    if (link.fed.contains(label.map)) listener_.delivered(name, label);
  }
}

void InProcess::label_removed(MapId map, LabelId label) {
  for (const auto& [name, link] : links_) {
    if (link.fed.contains(map)) listener_.delivered(name, LabelRemoved{map, label});
  }
}

void InProcess::ended(MapId map) {
  for (auto& [name, link] : links_) link.fed.erase(map);
}

}  // namespace cairn::simulation
