// SPDX-License-Identifier: Apache-2.0
#include "server/service/simulation/history.h"

#include <fmt/format.h>

#include <algorithm>

#include "server/store/map_file.h"

namespace cairn::simulation {
namespace {

std::string short_name(MapId map) {
  return to_hex(map.bytes).substr(0, 8);
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

void History::arrives(const std::string& client, const wire::MapSeed& seed) {
  Asked& asked = seeds_asked_[{client, seed.command.session, seed.command.seq}];
  asked.was_allowed = asked.was_allowed || allowed_.may_create(client);
  asked.times = {seed.first_time, seed.second_time};
}

void History::arrives(const std::string& client, const wire::KeyframeOffer& offer) {
  Asked& asked = offers_asked_[{client, offer.command.session, offer.command.seq}];
  asked.was_allowed = asked.was_allowed || allowed_.in_map(client, offer.map) >= Right::kAdd;
  asked.map = offer.map;
  asked.times = {offer.time};
}

void History::arrives(const std::string& client, const wire::ClientRequest& request) {
  Asked& asked = requests_asked_[{client, request.command.session, request.command.seq}];
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
  shown.newest = newest;
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
void History::say_decided(const std::string& what, const Command& command, const Outcome& outcome,
                          bool accepted, std::map<Command, Said>* said,
                          const std::map<Command, Asked>& asked) {
  const auto request = asked.find(command);
  if (request == asked.end())
    return violated(fmt::format("{} of {} is decided, and never arrived", what, words(command)));
  if (accepted && !request->second.was_allowed)
    violated(fmt::format("{} of {} is accepted without a right to it", what, words(command)));
  Said now;
  now.is_accepted = accepted;
  now.map = outcome.map;
  now.server = server_;
  if constexpr (requires { outcome.keyframe; }) now.keyframe = outcome.keyframe;
  if constexpr (requires { outcome.label; }) now.label = outcome.label;
  const auto [before, is_first] = said->try_emplace(command, now);
  if (is_first) return;
  const Said& then = before->second;
  const bool is_same =
      then.is_accepted == now.is_accepted &&
      (!accepted || (then.map == now.map && then.keyframe == now.keyframe && then.label == now.label));
  // What was refused need not be kept: after a restart it may be judged anew. The decisions on a map rest
  // with it when it is deleted: after a restart they are known as little as the map.
  const auto decided_on = maps_.find(then.map);
  const bool rests = decided_on != maps_.end() && decided_on->second.was_deleted;
  const bool may_differ = then.server != server_ && (!then.is_accepted || (rests && !accepted));
  if (!is_same && !may_differ)
    violated(fmt::format("{} of {} was {} at start {} and is {} at start {}: {}", what, words(command),
                         then.is_accepted ? "accepted" : "refused", then.server,
                         accepted ? "accepted" : "refused", server_, outcome.reason));
  if (accepted || !then.is_accepted) before->second = now;
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
    say_decided("offer", command, outcome, accepted, &offers_, offers_asked_);
    if (!accepted || !offers_asked_.contains(command)) continue;
    const Timestamp time = offers_asked_.at(command).times.front();
    const auto [known, is_new] = maps_[outcome.map].keyframes.try_emplace(outcome.keyframe, time);
    if (known->second != time)
      violated(fmt::format("keyframe {} of map {} is said to be that of two offers", outcome.keyframe.value,
                           short_name(outcome.map)));
    if (!shown_[outcome.map].keyframes.contains(outcome.keyframe))
      violated(fmt::format("offer of {} is accepted as keyframe {} of map {}, which has never shown it",
                           words(command), outcome.keyframe.value, short_name(outcome.map)));
  }
}

void History::say(const std::string& client, const wire::SeedVerdict& verdict) {
  const Command command{client, verdict.command.session, verdict.command.seq};
  say_decided("seed", command, verdict, verdict.accepted, &seeds_, seeds_asked_);
  if (!verdict.accepted || !seeds_asked_.contains(command)) return;
  const std::vector<Timestamp>& times = seeds_asked_.at(command).times;
  MadeMap& made = maps_[verdict.map];
  const Shown& shown = shown_[verdict.map];
  if (shown.newest == nullptr || !shown.keyframes.contains(verdict.first_keyframe) ||
      !shown.keyframes.contains(verdict.second_keyframe))
    return violated("map " + short_name(verdict.map) + " is said to be made, and has never shown its views");
  if (made.name.empty()) made.name = shown.newest->name;
  made.keyframes.emplace(verdict.first_keyframe, times[0]);
  made.keyframes.emplace(verdict.second_keyframe, times[1]);
}

void History::say(const std::string& client, const wire::ClientReply& reply) {
  uint64_t& last = last_decided_[{client, reply.session, server_, 'r'}];
  if (reply.last_decided < last) violated(client + ": fewer requests are decided than before");
  last = reply.last_decided;
  for (const wire::RequestOutcome& outcome : reply.recent) {
    const Command command{client, reply.session, outcome.seq};
    const bool done = outcome.decision == wire::RequestDecision::kDone;
    say_decided("request", command, outcome, done, &requests_, requests_asked_);
    const auto asked = requests_asked_.find(command);
    if (!done || asked == requests_asked_.end()) continue;
    if (asked->second.request.action != wire::RequestAction::kAddLabel) continue;
    const std::string& text = asked->second.request.text;
    const auto [known, is_new] = maps_[outcome.map].labels.try_emplace(outcome.label, text);
    if (known->second != text)
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
  for (const auto& [map, made] : maps_) {
    if (made.name.empty()) continue;  // it was never said to be made
    const std::string file = to_hex(map.bytes) + ".cairnmap";
    const bool is_live = std::filesystem::exists(folder / "maps" / file);
    const bool is_deleted = std::filesystem::exists(folder / "deleted" / file);
    if (is_live == is_deleted) {
      violated(fmt::format("map {} is {}", short_name(map), is_live ? "there twice" : "lost"));
      continue;
    }
    check_file(folder / (is_live ? "maps" : "deleted") / file, map, made);
  }
}

void History::check_file(const std::filesystem::path& path, MapId map, const MadeMap& made) {
  auto file = MapFile::open(path);
  if (!file) return violated("map " + short_name(map) + ": " + file.error().message);
  const StoredMap stored = file->load();
  for (const std::string& damage : stored.damage) violated("map " + short_name(map) + ": " + damage);
  std::map<KeyframeId, Timestamp> keyframes;
  std::map<Timestamp, KeyframeId> by_time;
  for (const KeyframeRecord& keyframe : stored.record.keyframes) {
    keyframes[keyframe.id] = keyframe.time;
    const auto [known, is_new] = by_time.emplace(keyframe.time, keyframe.id);
    if (!is_new)
      violated(fmt::format("map {}: keyframes {} and {} are of the same picture", short_name(map),
                           known->second.value, keyframe.id.value));
  }
  for (const auto& [keyframe, time] : made.keyframes) {
    const auto kept = keyframes.find(keyframe);
    if (kept == keyframes.end() || kept->second != time)
      violated(fmt::format("map {}: keyframe {} was accepted and is {}", short_name(map), keyframe.value,
                           kept == keyframes.end() ? "not kept" : "another"));
  }
  std::map<LabelId, std::string> labels;
  for (const LabelRecord& label : stored.labels) labels[LabelId{label.id}] = label.text;
  for (const auto& [label, text] : made.labels) {
    const auto kept = labels.find(label);
    const bool may_be_gone = made.maybe_removed.contains(label);
    const auto texts = made.texts.find(label);
    const bool may_be_called =
        kept != labels.end() && texts != made.texts.end() && texts->second.contains(kept->second);
    if (kept == labels.end() ? !may_be_gone : kept->second != text && !may_be_called)
      violated(fmt::format("map {}: label {} ('{}') was added and is {}", short_name(map), label.value, text,
                           kept == labels.end() ? "not kept" : "called '" + kept->second + "'"));
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
