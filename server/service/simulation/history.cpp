// SPDX-License-Identifier: Apache-2.0
#include "server/service/simulation/history.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <utility>

namespace cairn::simulation {
namespace {

/// What the server does not publish at once, since nobody would see it: 0.2 pixels of these cameras, at any
/// depth in these places.
constexpr double kUnpublished = 5e-3;

std::string short_name(MapId map) {
  return to_hex(map.bytes).substr(0, 8);
}

/// Live points of a map.
std::map<PointId, Eigen::Vector3f> points_of(const MapSnapshot& map) {
  std::map<PointId, Eigen::Vector3f> points;
  for (const auto& block : map.point_blocks) {
    for (size_t slot = 0; slot < block->positions->positions.size(); ++slot)
      if ((block->positions->live >> slot & 1) != 0)
        points.emplace(block->patches->points[slot].id, block->positions->positions[slot]);
  }
  return points;
}

std::map<KeyframeId, KeyframePose> keyframes_of(const MapSnapshot& map) {
  std::map<KeyframeId, KeyframePose> keyframes;
  for (const auto& block : map.keyframe_blocks) {
    for (size_t slot = 0; slot < block->keyframes.size(); ++slot)
      if ((block->live >> slot & 1) != 0)
        keyframes.emplace(block->keyframes[slot].id, block->keyframes[slot]);
  }
  return keyframes;
}

/// How far apart two maps are at most, in poses and positions; infinite where one has what the other has not.
double distance_of(const MapSnapshot& a, const MapSnapshot& b) {
  const auto far = std::numeric_limits<double>::infinity();
  const auto [points, other_points] = std::pair(points_of(a), points_of(b));
  const auto [keyframes, other_keyframes] = std::pair(keyframes_of(a), keyframes_of(b));
  if (points.size() != other_points.size() || keyframes.size() != other_keyframes.size()) return far;
  double distance = 0;
  for (const auto& [id, position] : points) {
    const auto other = other_points.find(id);
    if (other == other_points.end()) return far;
    distance = std::max<double>(distance, (position - other->second).norm());
  }
  for (const auto& [id, keyframe] : keyframes) {
    const auto other = other_keyframes.find(id);
    if (other == other_keyframes.end()) return far;
    const SE3 between = keyframe.camera_from_map * other->second.camera_from_map.inverse();
    distance = std::max({distance, between.translation().norm(), so3_log(between.rotation()).norm()});
  }
  return distance;
}

std::string words(const std::tuple<std::string, SessionId, uint64_t>& command) {
  const auto& [client, session, seq] = command;
  return fmt::format("{}, session {}, number {}", client, session.value % 10000, seq);
}

}  // namespace

void History::server_started() {
  allowed_ = {};
  ++server_;
  listed_.clear();
}

template <typename Message>
History::Asked& History::arrived(std::map<Command, Asked>* asked, const std::string& client,
                                 const Message& message) {
  const auto [found, is_new] =
      asked->try_emplace({client, message.command.session, message.command.seq}, Asked{});
  if (is_new) found->second.arrived = ++now_;
  return found->second;
}

void History::arrives(const std::string& client, const wire::MapSeed& seed) {
  Asked& asked = arrived(&seeds_asked_, client, seed);
  asked.was_allowed = asked.was_allowed || allowed_.may_create(client);
  asked.times = {seed.first_time, seed.second_time};
}

void History::arrives(const std::string& client, const wire::KeyframeOffer& offer) {
  Asked& asked = arrived(&offers_asked_, client, offer);
  asked.was_allowed = asked.was_allowed || allowed_.in_map(client, offer.map) >= Right::kAdd;
  asked.map = offer.map;
  asked.times = {offer.time};
}

void History::arrives(const std::string& client, const wire::ClientRequest& request) {
  Asked& asked = arrived(&requests_asked_, client, request);
  asked.was_allowed = asked.was_allowed || allowed_.in_map(client, request.map) >= Right::kAdd;
  asked.map = request.map;
  asked.request = request;
  if (request.action == wire::RequestAction::kRemoveLabel)
    maps_[request.map].maybe_removed.insert(request.label);
  if (request.action == wire::RequestAction::kRenameLabel)
    maps_[request.map].texts[request.label].insert(request.text);
}

void History::undeleted(MapId map, const std::string& name) {
  maps_[map].is_deleted = false;
  maps_[map].name = name;
}

void History::tagged(MapId map, const std::string& tag) {
  maps_[map].tag(tag, shown_[map].keyframes, ++now_);
}

void History::asked_to_roll_back(MapId map, const std::string& tag) {
  const MapSnapshotPtr& newest = shown_[map].newest;
  maps_[map].ask_to_roll_back(tag, newest == nullptr ? Epoch{} : newest->epoch);
}

void History::rolled_back(MapId map) {
  if (const auto wrong = maps_[map].roll_back(*shown_[map].newest, ++now_))
    violated("map " + short_name(map) + " " + *wrong);
}

void History::asked_to_copy(MapId map) {
  copying_[map] = {maps_[map].copy(), {shown_[map].newest}};
}

void History::copied(MapId map, MapId copy, const std::string& name) {
  Copying copying = std::move(copying_.extract(map).mapped());
  // What clients asked for meanwhile may have been done before the copy was made.
  for (const auto& [label, texts] : maps_[map].texts)
    copying.known.texts[label].insert(texts.begin(), texts.end());
  copying.known.maybe_removed.insert(maps_[map].maybe_removed.begin(), maps_[map].maybe_removed.end());
  maps_[copy] = std::move(copying.known);
  maps_[copy].name = name;
  const std::vector<MapSnapshotPtr>& was = copying.revisions;
  const MapSnapshotPtr& is = shown_[copy].first;
  if (is == nullptr) return violated("copy " + short_name(copy) + " is said to be made, and was never shown");
  double nearest = std::numeric_limits<double>::infinity();
  for (const MapSnapshotPtr& each : was) nearest = std::min(nearest, distance_of(*each, *is));
  if (nearest > kUnpublished)
    violated(
        fmt::format("copy {} has {} keyframes and {} points, and is {} from the nearest of {} revisions of "
                    "map {}, the last with {} and {}",
                    short_name(copy), is->keyframe_count(), is->point_count(), nearest, was.size(),
                    short_name(map), was.back()->keyframe_count(), was.back()->point_count()));
}

void History::proposed(const std::string& id) {
  const auto [known, is_new] = proposals_.try_emplace(id, false);
  if (known->second) violated("proposal " + id + " was decided, and waits");
}

void History::decided(const std::string& id, MapId map, std::optional<KeyframeId> keyframe) {
  if (std::exchange(proposals_[id], true)) violated("proposal " + id + " is decided twice");
  if (!keyframe) return;
  if (!shown_[map].keyframes.contains(*keyframe))
    violated("proposal " + id + " is accepted as a keyframe that its map has never shown");
  maps_[map].accept_proposal(*keyframe);
}

std::vector<MapId> History::maps() const {
  std::vector<MapId> all;
  for (const auto& [map, made] : maps_) {
    if (!made.name.empty()) all.push_back(map);
  }
  return all;
}

void History::revised(MapId map, const MapSnapshotPtr& newest) {
  Shown& shown = shown_[map];
  if (shown.newest != nullptr) check_follows(*shown.newest, *newest);
  if (shown.first == nullptr) shown.first = newest;
  shown.newest = newest;
  if (const auto copying = copying_.find(map); copying != copying_.end())
    copying->second.revisions.push_back(newest);
  for (const auto& block : newest->keyframe_blocks) {
    for (const KeyframePose& keyframe : block->keyframes) shown.keyframes.insert(keyframe.id);
  }
}

void History::check_follows(const MapSnapshot& before, const MapSnapshot& now) {
  const auto went_back = [&](const std::string& what) {
    violated(fmt::format("map {}: {} goes back: epoch {} revision {} after epoch {} revision {}",
                         short_name(now.map), what, now.epoch.value, now.revision.value, before.epoch.value,
                         before.revision.value));
  };
  if (now.epoch < before.epoch) went_back("the epoch");
  if (now.epoch != before.epoch) return;
  if (now.revision < before.revision) went_back("the revision");
  for (size_t i = 0; i < before.point_blocks.size(); ++i) {
    if (i >= now.point_blocks.size()) return went_back("a block of points is gone, it");
    const PositionBlock& then = *before.point_blocks[i]->positions;
    const PositionBlock& new_one = *now.point_blocks[i]->positions;
    if (new_one.version < then.version) went_back("a block");
    if (new_one.version == then.version && new_one.positions != then.positions)
      went_back("a block that is another under the same version");
  }
}

void History::check_readable(const std::string& client, MapId map, const char* what) {
  if (allowed_.in_map(client, map) < Right::kRead)
    violated(fmt::format("{} is sent {} of map {}, which it may not read", client, what, short_name(map)));
}

void History::delivered(const std::string& client, const Delivery& delivery) {
  if (const auto* snapshot = std::get_if<MapSnapshotPtr>(&delivery))
    return check_readable(client, (*snapshot)->map, "a revision");
  if (const auto* label = std::get_if<wire::LabelMessage>(&delivery))
    return check_readable(client, label->map, "a label");
  if (const auto* removed = std::get_if<LabelRemoved>(&delivery))
    return check_readable(client, removed->map, "the removal of a label");
  const ClientEvent& event = std::get<ClientEvent>(delivery);
  if (const auto* info = std::get_if<wire::MapInfo>(&event)) {
    check_readable(client, info->map, "the name");
    listed_[client][info->map] = *info;
  } else if (const auto* gone = std::get_if<MapUnlisted>(&event)) {
    listed_[client].erase(gone->map);
  } else if (const auto* offers = std::get_if<wire::OfferVerdict>(&event)) {
    say(client, *offers);
  } else if (const auto* seed = std::get_if<wire::SeedVerdict>(&event)) {
    say(client, *seed);
  } else if (const auto* requests = std::get_if<wire::ClientReply>(&event)) {
    say(client, *requests);
  } else if (const auto* answer = std::get_if<wire::RelocAnswer>(&event)) {
    say(client, *answer);
  } else if (const auto* estimate = std::get_if<wire::CameraEstimate>(&event)) {
    check_readable(client, estimate->map, "a camera");
  }
}

template <typename Outcome>
bool History::say_decided(const std::string& what, const Command& command, const Outcome& outcome,
                          bool accepted, std::map<Command, Said>* said,
                          const std::map<Command, Asked>& asked) {
  const auto request = asked.find(command);
  if (request == asked.end()) {
    violated(fmt::format("{} of {} is decided, and never arrived", what, words(command)));
    return false;
  }
  const auto in_map = maps_.find(outcome.map);
  const bool was_allowed =
      request->second.was_allowed || (in_map != maps_.end() && in_map->second.proposals_are_accepted);
  if (accepted && !was_allowed)
    violated(fmt::format("{} of {} is accepted without a right to it", what, words(command)));
  Said now;
  now.is_accepted = accepted;
  now.map = outcome.map;
  now.server = server_;
  if constexpr (requires { outcome.keyframe; }) now.keyframe = outcome.keyframe;
  if constexpr (requires { outcome.label; }) now.label = outcome.label;
  const auto [before, is_first] = said->try_emplace(command, now);
  if (is_first) return accepted;
  const Said then = before->second;
  const auto decided_on = maps_.find(then.map);
  const bool is_known = decided_on != maps_.end();
  // A keyframe that went with a roll-back is no one's after a restart.
  const bool may_have_gone = is_known && decided_on->second.was_rolled_back && !now.keyframe;
  const bool is_same =
      then.is_accepted == now.is_accepted &&
      (!accepted ||
       (then.map == now.map && (then.keyframe == now.keyframe || may_have_gone) && then.label == now.label));
  // What was refused need not be kept: after a restart it may be judged anew.
  const bool may_differ = then.server != server_ && !then.is_accepted;
  if (!is_same && !may_differ)
    violated(fmt::format("{} of {} was {} at start {} and is {} at start {}: {}", what, words(command),
                         then.is_accepted ? "accepted" : "refused", then.server,
                         accepted ? "accepted" : "refused", server_, outcome.reason));
  if (accepted || !then.is_accepted) before->second = now;
  return accepted && !then.is_accepted;
}

void History::say(const std::string& client, const wire::OfferVerdict& verdict) {
  if (!verdict.recent.empty() && verdict.recent.front().seq == 0) return;  // to an intruder
  uint64_t& last = last_decided_[{client, verdict.session, server_, 'o'}];
  if (verdict.last_decided < last) violated(client + ": fewer offers are decided than before");
  last = verdict.last_decided;
  if (verdict.credit != OfferGate::kCredit) violated(client + ": another credit");
  for (const wire::OfferOutcome& outcome : verdict.recent) {
    const Command command{client, verdict.session, outcome.seq};
    const bool accepted = outcome.decision == wire::OfferDecision::kAccepted;
    if (!say_decided("offer", command, outcome, accepted, &offers_, offers_asked_)) continue;
    const Asked& asked = offers_asked_.at(command);
    if (!outcome.keyframe && maps_[outcome.map].was_rolled_back) continue;  // it went before this was heard
    if (!maps_[outcome.map].accept(outcome.keyframe, asked.times.front(), asked.arrived))
      violated(fmt::format("keyframe {} of map {} is said to be that of two offers", outcome.keyframe.value,
                           short_name(outcome.map)));
    if (!shown_[outcome.map].keyframes.contains(outcome.keyframe))
      violated(fmt::format("offer of {} is accepted as keyframe {} of map {}, which has never shown it",
                           words(command), outcome.keyframe.value, short_name(outcome.map)));
  }
}

void History::say(const std::string& client, const wire::SeedVerdict& verdict) {
  const Command command{client, verdict.command.session, verdict.command.seq};
  if (!say_decided("seed", command, verdict, verdict.accepted, &seeds_, seeds_asked_)) return;
  const Asked& asked = seeds_asked_.at(command);
  MadeMap& made = maps_[verdict.map];
  const Shown& shown = shown_[verdict.map];
  if (shown.newest == nullptr || !shown.keyframes.contains(verdict.first_keyframe) ||
      !shown.keyframes.contains(verdict.second_keyframe))
    return violated("map " + short_name(verdict.map) + " is said to be made, and has never shown its views");
  if (made.name.empty()) made.name = shown.newest->name;
  (void)made.accept(verdict.first_keyframe, asked.times[0], asked.arrived);
  (void)made.accept(verdict.second_keyframe, asked.times[1], asked.arrived);
}

void History::say(const std::string& client, const wire::ClientReply& reply) {
  uint64_t& last = last_decided_[{client, reply.session, server_, 'r'}];
  if (reply.last_decided < last) violated(client + ": fewer requests are decided than before");
  last = reply.last_decided;
  for (const wire::RequestOutcome& outcome : reply.recent) {
    const Command command{client, reply.session, outcome.seq};
    const bool done = outcome.decision == wire::RequestDecision::kDone;
    if (!say_decided("request", command, outcome, done, &requests_, requests_asked_)) continue;
    const Asked& asked = requests_asked_.at(command);
    if (asked.request.action != wire::RequestAction::kAddLabel) continue;
    if (!maps_[outcome.map].label(outcome.label, asked.request.text, asked.arrived))
      violated(fmt::format("label {} of map {} is said to be that of two requests", outcome.label.value,
                           short_name(outcome.map)));
  }
}

void History::say(const std::string& client, const wire::RelocAnswer& answer) {
  for (const PlaceCandidate& place : answer.answer.candidates) {
    check_readable(client, place.map, "a place");
    if (!shown_[place.map].keyframes.contains(place.keyframe))
      violated(fmt::format("a place is near keyframe {} of map {}, which has never shown it",
                           place.keyframe.value, short_name(place.map)));
  }
}

void History::check_store(const std::filesystem::path& folder) {
  ++now_;
  for (auto& [map, made] : maps_) {
    if (made.name.empty()) continue;  // it was never said to be made
    const std::string file = to_hex(map.bytes) + ".cairnmap";
    const bool is_live = std::filesystem::exists(folder / "maps" / file);
    const bool is_deleted = std::filesystem::exists(folder / "deleted" / file);
    if (is_live == is_deleted) {
      violated(fmt::format("map {} is {}", short_name(map), is_live ? "there twice" : "lost"));
      continue;
    }
    made.check_kept(
        folder / (is_live ? "maps" : "deleted") / file, now_,
        [this, id = map](const std::string& what) { violated("map " + short_name(id) + ": " + what); });
  }
}

void History::check_restored(const std::filesystem::path& folder, const std::map<MapId, MadeMap>& known) {
  for (const auto& [map, made] : known) {
    const std::string file = to_hex(map.bytes) + ".cairnmap";
    const bool is_live = std::filesystem::exists(folder / "maps" / file);
    made.check_copied(folder / (is_live ? "maps" : "deleted") / file,
                      [this, id = map](const std::string& what) {
                        violated("map " + short_name(id) + " of a backup: " + what);
                      });
  }
}

void History::check_listed(const std::set<std::string>& connected_clients) {
  for (const std::string& client : connected_clients) {
    const auto& listed = listed_[client];
    for (const auto& [map, made] : maps_) {
      if (made.name.empty()) continue;
      const bool should_be = !made.is_deleted && allowed_.in_map(client, map) >= Right::kRead;
      const auto info = listed.find(map);
      if (should_be != (info != listed.end())) {
        violated(fmt::format("map {} ({}) is {} to {}", short_name(map), made.name,
                             should_be ? "not listed" : "listed", client));
      } else if (should_be && info->second.name != made.name) {
        violated(fmt::format("map {} should be called {} and is listed as {}", short_name(map), made.name,
                             info->second.name));
      }
    }
  }
}

}  // namespace cairn::simulation
