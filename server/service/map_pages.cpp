// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "common/base/utc.h"
#include "common/base/utf8.h"
#include "server/service/admin_json.h"

namespace cairn {

using nlohmann::json;

namespace {

constexpr size_t kMaxReasons = 5;  ///< of a damaged file

const char* word_of(TrackingState state) {
  switch (state) {
    case TrackingState::kTracking:
      return "tracking";
    case TrackingState::kPoor:
      return "poor";
    case TrackingState::kLost:
      return "lost";
    case TrackingState::kRotation:
      return "rotation";
    case TrackingState::kStarting:
      break;
  }
  return "starting";
}

json corner(const Eigen::Vector3f& at) {
  return {at.x(), at.y(), at.z()};
}

}  // namespace

json describe(const told::RigSeen& rig) {
  const wire::RigState& state = rig.state;
  json item = {{"rig", state.rig},
               {"mode", std::string(wire::name_of(state.mode))},
               {"commander", state.commander},
               {"stopped", state.stopped},
               {"drives_idle", state.drives_idle},
               {"faults", {{"pan", state.axes[0].fault}, {"tilt", state.axes[1].fault}}},
               {"trouble", state.trouble},
               {"silent", rig.silent},
               {"heard_s_ago", std::chrono::duration<double>(rig.heard_ago).count()}};
  if (state.order.session.value != 0) {
    item["last_order"] = {{"by", state.ordered_by},
                          {"mode", std::string(wire::name_of(state.ordered))},
                          {"refusal", state.refusal}};
  }
  return item;
}

json describe(const told::ClientSeen& client) {
  json told{
      {"name", client.name}, {"connected", false}, {"blocked", client.blocked}, {"revoked", client.revoked}};
  if (client.known) {
    told["connected"] = client.known->connected;
    told["proven"] = client.known->proven;
    if (!client.known->wearer.empty()) told["wearer"] = client.known->wearer;
  }
  if (client.tracker) {
    told["state"] = word_of(client.tracker->state);
    told["quality"] = client.tracker->quality;
    if (client.tracker->map) told["map"] = *client.tracker->map;
  }
  return told;
}

json describe(const told::OverlapSeen& overlap) {
  return {{"map", overlap.map},
          {"id", to_hex(overlap.id.bytes)},
          {"keyframes", overlap.keyframes},
          {"its_keyframes", overlap.its_keyframes},
          {"found", overlap.found.nanoseconds}};
}

json describe(const std::pair<CameraParameters, size_t>& taken) {
  const auto& [camera, keyframes] = taken;
  return {{"model", std::string(name_of(camera.model))},
          {"width", camera.width},
          {"height", camera.height},
          {"focal_px", camera.values.at(0)},
          {"keyframes", keyframes}};
}

json describe(const told::Server& server) {
  json wearers = json::object();
  for (const auto& [client, wearer] : server.wearers) wearers[client] = wearer;
  return {{"server", to_hex(server.server.bytes)},
          {"version", server.version},
          {"start_count", server.start_count},
          {"health", server.health},
          {"store", server.store.empty() ? std::string() : one_line(server.store.string())},
          {"maps", server.maps},
          {"maps_at_rest", server.idle_maps},
          {"memory_bytes", server.memory_bytes},
          {"limits",
           {{"maps", server.max_maps},
            {"memory_bytes", server.max_memory_bytes},
            {"rest_after_s", server.idle_after.count()}}},
          {"damaged", list_of(server.damaged)},
          {"damaged_files", server.damaged_files},
          {"unloaded", list_of(server.unloaded)},
          {"unloaded_maps", server.unloaded_maps},
          {"clients", server.clients},
          {"wearers", std::move(wearers)}};
}

json describe(const told::Rigs& rigs) {
  return {{"rigs", list_of(rigs.rigs)}};
}

json describe(const told::Clients& clients) {
  return {{"clients", list_of(clients.clients)}};
}

json describe(const told::Map& map) {
  json told{{"id", to_hex(map.id.bytes)},        {"name", map.name},
            {"keyframes", map.keyframes},        {"points", map.points},
            {"epoch", map.epoch.value},          {"revision", map.revision.value},
            {"memory_bytes", map.memory_bytes},  {"at_rest", map.is_idle},
            {"plane_aligned", map.plane_aligned}};
  if (!map.failed.empty()) told["failed"] = map.failed;
  return told;
}

json describe(const told::BusyMap& map) {
  json told = describe(map.map);
  if (!map.frozen.empty()) told["frozen"] = map.frozen;
  told["bounds"] = {{"min", corner(map.bounds_min)}, {"max", corner(map.bounds_max)}};
  told["clients"] = map.clients;
  if (map.localized) told["localized"] = to_utc(*map.localized);
  told["offers_accepted"] = map.offers_accepted;
  if (map.offer_p50_ms) told["offer_p50_ms"] = *map.offer_p50_ms;
  if (map.offer_p95_ms) told["offer_p95_ms"] = *map.offer_p95_ms;
  told["overlaps"] = list_of(map.overlaps);
  return told;
}

json describe(const told::WholeMap& map) {
  json told = describe(map.map);
  told["labels"] = map.labels;
  if (!map.measures) return told;
  told["reprojection_px"] = map.measures->reprojection_px;
  told["cameras"] = list_of(map.measures->cameras);
  return told;
}

json describe(const told::Maps& maps) {
  ReplyPage page{"maps", "deleted", "damaged", "unloaded"};
  page.add_all("maps", maps.maps);
  page.add_all("deleted", maps.deleted);
  page.add_all("damaged", maps.damaged);
  page.add_all("unloaded", maps.unloaded);
  return page.content();
}

json describe(const DeletedMap& map) {
  json told{{"id", to_hex(map.header.id.bytes)},
            {"name", map.header.name},
            {"deleted", map.deleted.nanoseconds},
            {"bytes", map.bytes}};
  if (map.problem)
    told[map.problem->code == ErrorCode::kDamaged ? "damaged" : "unreadable"] = map.problem->message;
  return told;
}

json describe(const told::DamagedSeen& damaged) {
  const DamagedFile& file = damaged.file;
  const size_t told = std::min(file.reasons.size(), kMaxReasons);
  json reasons(
      std::vector<std::string>(file.reasons.begin(), file.reasons.begin() + static_cast<ptrdiff_t>(told)));
  if (told < file.reasons.size())
    reasons.push_back("and " + std::to_string(file.reasons.size() - told) + " more, in the .txt beside it");
  return {{"id", file.map ? to_hex(file.map.bytes) : std::string()},
          {"name", file.name},
          {"file", one_line(file.path.string())},
          {"bytes", file.bytes},
          {"set_aside", file.set_aside.nanoseconds},
          {"served", damaged.served},
          {"reasons", std::move(reasons)}};
}

json describe(const UnloadedMap& map) {
  return {{"id", to_hex(map.map.bytes)},
          {"name", map.name},
          {"file", one_line(map.file.string())},
          {"reason", map.reason}};
}

}  // namespace cairn
