// SPDX-License-Identifier: Apache-2.0
#include "server/service/simulation/operator.h"

#include <array>
#include <utility>

namespace cairn::simulation {

using nlohmann::json;

void SimulatedOperator::act() {
  const MonotonicTime now = world_.clock->now();
  if (!asked_ && now >= begin_at_ && !world_.is_calm) {
    begin_at_ = now + world_.between(100, static_cast<int>(pause_.count()));
    const std::vector<MapId> maps = world_.history.maps();
    if (!maps.empty()) ask(some_verb(maps[world_.draw(maps.size())]));
  }
  if (!asked_ || now < send_at_) return;
  send_at_ = now + world_.between(500, 1500);
  send();
}

void SimulatedOperator::ask(json request) {
  ++last_;
  asked_ = std::move(request);
  send_at_ = world_.clock->now();
}

json Housekeeper::some_verb(MapId map) {
  map_ = map;
  return world_.chance(0.5) ? some_map_verb() : some_rights_verb();
}

json Housekeeper::some_map_verb() {
  constexpr std::array kNames{"desk", "bench", "robot", "stairs"};
  const std::string id = to_hex(map_.bytes);
  if (world_.history.is_deleted(map_) && world_.chance(0.8)) return {{"verb", "undelete"}, {"map", id}};
  switch (world_.draw(4)) {
    case 0:
      return {{"verb", "delete"}, {"map", id}};
    case 1:
      return {{"verb", "show"}, {"map", id}};
    case 2:
      return {{"verb", "maps"}};
    default:
      return {{"verb", "rename"}, {"map", id}, {"name", kNames[world_.draw(kNames.size())]}};
  }
}

json Housekeeper::some_rights_verb() {
  constexpr std::array kRights{"none", "read", "add", "write", "write"};
  const std::string id = to_hex(map_.bytes);
  const std::string client = clients_[world_.draw(clients_.size())];
  const std::string to = world_.chance(0.3) ? "everyone" : "client " + client;
  const std::string map = world_.chance(0.3) ? "all" : id;
  switch (world_.draw(8)) {
    case 0:
    case 1:
    case 2:
      return {{"verb", "rights-grant"}, {"to", to}, {"map", map}, {"right", kRights[world_.draw(5)]}};
    case 3:
      return {{"verb", "rights-revoke"}, {"to", to}, {"map", map}};
    case 4:
      return {{"verb", "map-freeze"}, {"map", id}};
    case 5:
      return {{"verb", "map-unfreeze"}, {"map", id}};
    case 6:
      return {{"verb", world_.chance(0.3) ? "client-block" : "client-unblock"}, {"client", client}};
    default:
      return {{"verb", "rights-create"}, {"to", to}, {"may", world_.chance(0.7)}};
  }
}

void SimulatedOperator::send() {
  wire::AdminRequest request;
  request.operator_id = client_id_from_name(name_);
  request.command = {session_, last_};
  request.request = asked_->dump();
  // His program talks to the server that it sees: what it sent to another reaches nobody.
  world_.send(name_, [this, request, to = world_.history.server_starts()](ServerRun& server) {
    if (world_.history.server_starts() == to)
      server.service().take(operator_principal(name_, Principal::Proof::kClaimed, Duty::kAdminister),
                            request);
  });
}

void SimulatedOperator::receive(const wire::AdminReply& reply) {
  if (!asked_ || reply.command != wire::CommandId{session_, last_}) return;
  hear(*std::exchange(asked_, std::nullopt), reply);
}

void Housekeeper::hear(const json& asked, const wire::AdminReply& reply) {
  if (reply.result != 0) return;
  const std::string verb = asked.at("verb");
  if (verb == "delete") world_.history.deleted(map_);
  if (verb == "rename") world_.history.renamed(map_, asked.at("name"));
  if (verb == "undelete")
    world_.history.undeleted(map_, json::parse(reply.text).at("name").get<std::string>());
}

}  // namespace cairn::simulation
