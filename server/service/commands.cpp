// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <algorithm>
#include <utility>

#include "server/service/fitting_words.h"
#include "server/service/map_service.h"

/// Seeds, offers and questions on their way from the wire to the queue of a map and back.
namespace cairn {
namespace {

constexpr std::chrono::seconds kCameraGrace{3};  ///< commands and cameras are not in order with each other

constexpr const char* kNoLockstep =
    "this server does not work in lockstep, since that holds up all others; leave out --pace lockstep, or "
    "start cairn-server with --lockstep allow";

/// Whether a command whose camera is not known should be left until it is sent again.
bool may_yet_come(Client& client, MonotonicTime now) {
  if (!client.camera_missed_at) client.camera_missed_at = now;
  return now - *client.camera_missed_at < kCameraGrace;
}

/// Of the candidate answered or, where none is believed, of the one that came nearest to it.
std::string describe(const PlaceAnswer& answer) {
  if (answer.candidates.empty()) return answer.reason;
  const PlaceCandidate& best =
      !has_place(answer.verdict)
          ? *std::max_element(answer.candidates.begin(), answer.candidates.end(),
                              [](const auto& a, const auto& b) { return a.inliers < b.inliers; })
          : answer.candidates.front();
  return fmt::format("map {}, keyframe {}, {} corners alike, {} of {} points found, {} tried{}{}",
                     to_hex(best.map.bytes).substr(0, 8), best.keyframe.value, best.matches, best.inliers,
                     best.expected, answer.candidates.size(), best.reason.empty() ? "" : ": ", best.reason);
}

/// Of an answer, what is not of these maps.
void leave_out_others(const MapSet& maps, PlaceAnswer* answer) {
  const size_t found = answer->candidates.size();
  std::erase_if(answer->candidates, [&](const PlaceCandidate& place) { return !maps.contains(place.map); });
  const bool has_any = std::any_of(answer->candidates.begin(), answer->candidates.end(),
                                   [](const PlaceCandidate& place) { return place.confirmed; });
  if (answer->candidates.size() == found || (has_any && answer->verdict == PlaceVerdict::kConfirmed)) return;
  // Whether one of the others would have been found instead, the next question says.
  *answer = {PlaceVerdict::kNotThere, {}, "the maps that count have changed meanwhile; ask again"};
}

std::string unknown_camera(uint32_t camera, uint32_t version) {
  return "camera " + std::to_string(camera) + " in version " + std::to_string(version) +
         " is not known here: not announced, or refused (the server's log says why)";
}

}  // namespace

/// In lockstep all work of a map, whole adjustments included, holds up who else waits for a worker.
bool MapService::refuses_lockstep(Client& client, bool lockstep) {
  if (!lockstep || options_.lockstep) return false;
  if (!std::exchange(client.lockstep_refused, true)) {
    log_->warn("{}: refused: {}", client.name, kNoLockstep);
    write_verdicts(client);
  }
  return true;
}

void MapService::take(const Principal& who, wire::MapSeed message) {
  Client& client = client_of(who);
  if (!presence_.holds(client.name, message.command.session)) return;  // it will be sent again
  if (refuses_lockstep(client, message.lockstep)) return;
  const auto rate = client.rates.judge(ClientRates::Kind::kSeed, clock_.now(), message.lockstep);
  if (rate == ClientRates::Judgement::kPassOver) return;
  const AnnouncedCamera* camera = client.cameras.find(message.camera, message.camera_version);
  if (client.seed_in_work || (camera == nullptr && may_yet_come(client, clock_.now()))) return;
  switch (client.seed_gate.admit(message.command.seq)) {
    case SeedGate::Admission::kNew:
      break;
    case SeedGate::Admission::kRepeated:
      return write_verdicts(client);
    case SeedGate::Admission::kInFlight:
    case SeedGate::Admission::kSuperseded:
      return;
  }
  wire::SeedVerdict verdict;
  verdict.client = client.id;
  verdict.command = message.command;
  const auto refuse = [&](std::string reason) {
    on_seed_decided(client.name, verdict, fail(ErrorCode::kRefused, std::move(reason)), nullptr);
  };
  if (rate == ClientRates::Judgement::kRefuse) return refuse(client.rates.why(ClientRates::Kind::kSeed));
  if (camera == nullptr) return refuse(unknown_camera(message.camera, message.camera_version));
  client.camera_missed_at.reset();
  const Ruling ruling = options_.access->on_creating(client.principal());
  if (ruling.right < Right::kWrite) return refuse(ruling.reason);
  if (std::string why = why_full(); !why.empty()) return refuse(std::move(why));
  if (std::string why = why_maker_is_full(client); !why.empty()) return refuse(std::move(why));
  if (std::string why = store_ ? store_->trouble() : ""; !why.empty()) return refuse(std::move(why));

  client.seed_in_work = true;
  const bool may_die_young = !message.lockstep && message.map_name.empty();
  SeedJob job;
  job.input.map = message.lockstep ? maps_.repeatable_id(message) : maps_.next_id();
  job.input.map_name = maps_.free_name(message.map_name);
  job.input.epoch = {options_.start_count};
  job.input.camera = camera->camera;
  job.input.doubt = camera->doubt_of({client.id, message.camera, message.camera_version});
  job.input.first_time = message.first_time;
  job.input.second_time = message.second_time;
  job.input.trails = std::move(message.trails);
  job.input.second_from_first = message.second_from_first;
  job.input.second_up = message.second_up;
  job.input.still = still_mask_of(camera->camera->width(), camera->camera->height(), message.still_mask);
  job.input.extent = ruling.extent;
  job.first_image = std::move(message.first_image);
  job.second_image = std::move(message.second_image);
  job.lockstep = message.lockstep;
  const MapId map = job.input.map;
  const size_t bytes = job.first_image.bytes.size() + job.second_image.bytes.size();
  job.pending =
      client.pending_offers.add({PendingOffers::Kind::kSeed, map, ruling.extent}, bytes, waiting_bytes_);
  const auto pending = job.pending;

  job.origin = {client.name, message.command};
  auto runner = make_runner(map);
  MapEntry& entry = maps_.add(map, MapEntry{job.input.map_name, runner, {}, {}, {}});
  entry.seeding = true;
  entry.maker = client.name;
  verdict.map = map;
  if (may_die_young) young_.made(map, client.name, message.command.session);
  runner->start(std::move(job), [this, name = client.name, verdict, pending](Result<SeedResult> result,
                                                                             MapSnapshotPtr snapshot) {
    post_([this, name, verdict, pending, result = std::move(result), snapshot = std::move(snapshot)] {
      if (!result || !pending->is_withdrawn()) return on_seed_decided(name, verdict, result, snapshot);
      take_out(verdict.map);
      on_seed_decided(name, verdict, fail(ErrorCode::kRefused, kSeedWithdrawn), nullptr);
    });
  });
}

/// It is in the store by now, and nobody has been told of it.
void MapService::take_out(MapId map) {
  if (const MapEntry* entry = maps_.find(map)) entry->runner->retire();
  if (store_ == nullptr) return;
  store_->run([map, log = log_](Store& store) {
    const Status gone = store.undo_import(map);
    if (!gone) log->error("a map that was not to be made is still there: {}", gone.error().message);
  });
}

void MapService::on_seed_decided(const std::string& client_name, wire::SeedVerdict verdict,
                                 const Result<SeedResult>& result, const MapSnapshotPtr& snapshot) {
  MapEntry* entry = maps_.find(verdict.map);
  verdict.accepted = result && entry != nullptr && entry->undecided;
  if (verdict.accepted) {
    verdict.epoch = snapshot->epoch;
    verdict.revision = snapshot->revision;
    verdict.first_keyframe = result->first_keyframe;
    verdict.second_keyframe = result->second_keyframe;
    verdict.points = result->points;
    entry->plane_aligned = result->plane_aligned;
    entry->seeding = false;
    on_map_changed(verdict.map, *std::exchange(entry->undecided, {}));
    log_->info("{}: {} made, {} points{}", client_name, entry->name, snapshot->point_count(),
               result->plane_aligned ? ", on its plane" : "");
    list_map(verdict.map, *entry);
  } else {
    verdict.reason = result ? "internal error; the server's log says more" : result.error().message;
    log_->info("{}: no map made: {}", client_name, verdict.reason);
    forget_map(verdict.map);
    verdict.map = {};
  }
  const auto client = clients_.find(client_name);
  if (client == clients_.end()) return;
  client->second.seed_in_work = false;
  if (client->second.seed_gate.decide(verdict)) write_verdicts(client->second);
}

void MapService::take(const Principal& who, wire::KeyframeOffer message) {
  Client& client = client_of(who);
  if (!presence_.holds(client.name, message.command.session)) return;
  if (refuses_lockstep(client, message.lockstep)) return;
  const auto rate = client.rates.judge(ClientRates::Kind::kKeyframe, clock_.now(), message.lockstep);
  if (rate == ClientRates::Judgement::kPassOver) return;
  const AnnouncedCamera* camera = client.cameras.find(message.camera, message.camera_version);
  if (camera == nullptr && may_yet_come(client, clock_.now())) return;
  wire::OfferOutcome outcome;
  outcome.seq = message.command.seq;
  outcome.map = message.map;
  const SessionId session = message.command.session;
  const auto refuse = [&](wire::OfferDecision decision, std::string reason) {
    outcome.decision = decision;
    outcome.reason = std::move(reason);
    on_offer_decided(client.name, session, outcome);
  };
  switch (client.offer_gate.admit(outcome.seq)) {
    case OfferGate::Admission::kNew:
      break;
    case OfferGate::Admission::kNoCredit:
      return refuse(wire::OfferDecision::kBusy, "more offers under way than the credit allows");
    case OfferGate::Admission::kRepeated:
      return write_verdicts(client);
    case OfferGate::Admission::kInFlight:
    case OfferGate::Admission::kGap:
      return;
  }
  if (rate == ClientRates::Judgement::kRefuse)
    return refuse(wire::OfferDecision::kBusy, client.rates.why(ClientRates::Kind::kKeyframe));
  if (camera == nullptr) {
    return refuse(wire::OfferDecision::kDamaged, unknown_camera(message.camera, message.camera_version));
  }
  client.camera_missed_at.reset();
  MapEntry* entry = maps_.find(message.map);
  const Ruling ruling = options_.access->in_map(client.principal(), message.map);
  if (entry == nullptr || entry->snapshot == nullptr || ruling.right == Right::kNone) {
    return refuse(wire::OfferDecision::kUnknownMap, "this server does not know the map");
  }
  if (takes_proposals(client, message.map, *entry)) {
    if (std::string why = why_aside(message, *entry, ruling); !why.empty())
      return propose(&client, *entry, std::move(message), *camera, std::move(why));
  }
  if (message.as_proposal) return refuse(wire::OfferDecision::kNoRight, kNoProposals);
  if (ruling.right < Right::kAdd) return refuse(wire::OfferDecision::kNoRight, ruling.reason);
  if (entry->runner == nullptr) return refuse(wire::OfferDecision::kNoRight, "this map takes no keyframes");
  if (std::string why = why_map_is_full(*entry); !why.empty())
    return refuse(wire::OfferDecision::kFull, std::move(why));
  if (*waiting_bytes_ + message.image.bytes.size() > options_.max_waiting_bytes)
    return refuse(wire::OfferDecision::kBusy, "too many keyframes of all clients wait for their maps");

  OfferJob job;
  job.origin = {client.name, message.command};
  job.input.camera = camera->camera;
  job.input.doubt = camera->doubt_of({client.id, message.camera, message.camera_version});
  job.input.time = message.time;
  job.input.reference = message.reference;
  job.reference_command = message.reference_command;
  job.input.camera_from_reference = message.camera_from_reference;
  job.input.measurements = std::move(message.measurements);
  job.input.candidates = std::move(message.candidates);
  job.input.up = message.up;
  job.input.still = still_mask_of(camera->camera->width(), camera->camera->height(), message.still_mask);
  job.input.extent = ruling.extent;
  job.epoch = message.epoch;
  job.image = std::move(message.image);
  job.lockstep = message.lockstep;
  job.pending = client.pending_offers.add({PendingOffers::Kind::kKeyframe, message.map, ruling.extent},
                                          job.image.bytes.size(), waiting_bytes_);
  outcome.epoch = entry->snapshot->epoch;
  entry->used_at = clock_.now();
  const auto done = [this, name = client.name, session, outcome, arrived = clock_.now(),
                     runner = entry->runner](OfferJudgement judgement) mutable {
    outcome.decision = judgement.decision;
    outcome.reason = std::move(judgement.reason);
    outcome.keyframe = judgement.keyframe;
    outcome.revision = judgement.revision;
    post_([this, name, session, outcome, arrived, runner] {
      MapEntry* judged = maps_.find(outcome.map);
      if (judged != nullptr) {
        judged->offer_times.note(clock_.now() - arrived, outcome.decision == wire::OfferDecision::kAccepted);
      }
      if (judged != nullptr && judged->runner == runner) maps_.end_offer(judged);
      on_offer_decided(name, session, outcome);
    });
  };
  entry->runner->offer(std::move(job), done);
  maps_.begin_offer(entry);
}

void MapService::on_offer_decided(const std::string& client_name, SessionId session,
                                  wire::OfferOutcome outcome) {
  log_->debug("{}: offer {}: {}", client_name, outcome.seq,
              outcome.reason.empty() ? "keyframe " + std::to_string(outcome.keyframe.value) : outcome.reason);
  if (outcome.decision == wire::OfferDecision::kAccepted) young_.forget(outcome.map);
  const auto client = clients_.find(client_name);
  if (client == clients_.end()) return;
  client->second.offer_gate.decide(session, std::move(outcome));
  write_verdicts(client->second);
}

CameraPtr MapService::best_known(const Client& client, uint32_t camera,
                                 const AnnouncedCamera& announced) const {
  if (!announced.doubt) return announced.camera;
  for (const auto& [map, entry] : maps_.all()) {
    for (const CameraEstimate& estimate : entry.statistics.cameras) {
      if (estimate.frozen && estimate.version.client == client.id && estimate.version.camera == camera)
        return estimate.camera;
    }
  }
  return announced.camera;
}

void MapService::take(const Principal& who, wire::RelocQuery message) {
  Client& client = client_of(who);
  if (!presence_.holds(client.name, message.command.session) || client.query_in_work) return;
  if (refuses_lockstep(client, message.lockstep)) return;
  const auto rate = client.rates.judge(ClientRates::Kind::kQuestion, clock_.now(), message.lockstep);
  if (rate == ClientRates::Judgement::kPassOver) return;
  if (rate == ClientRates::Judgement::kRefuse) {
    return on_query_answered(client.name, message.command,
                             {PlaceVerdict::kNotThere, {}, client.rates.why(ClientRates::Kind::kQuestion)});
  }
  const AnnouncedCamera* announced = client.cameras.find(message.camera, message.camera_version);
  if (announced == nullptr && may_yet_come(client, clock_.now())) return;  // it will be asked again
  if (announced == nullptr) {
    std::string why = unknown_camera(message.camera, message.camera_version);
    return on_query_answered(client.name, message.command, {PlaceVerdict::kNotThere, {}, std::move(why)});
  }
  client.camera_missed_at.reset();
  client.query_in_work = true;
  const WearerRule::Search search = wearers_.search(client.name, readable(client), clock_.now());
  lanes_.questions.submit([this, name = client.name, camera = best_known(client, message.camera, *announced),
                           message = std::move(message), search]() mutable {
    const wire::CommandId command = message.command;
    try {
      look_up(name, camera, std::move(message), search);
    } catch (const std::exception& problem) {  // memory, a library
      post_([this, name, command, why = std::string("internal error: ") + problem.what()] {
        on_query_answered(name, command, {PlaceVerdict::kNotThere, {}, why});
      });
    }
  });
}

void MapService::look_up(const std::string& client, const CameraPtr& camera, wire::RelocQuery message,
                         const WearerRule::Search& search) {
  const auto done = [this, client, command = message.command, in_part = search.in_part](PlaceAnswer answer) {
    post_([this, client, command, in_part, answer = std::move(answer)]() mutable {
      const auto asking = clients_.find(client);
      if (asking == clients_.end()) return;
      const MonotonicTime now = clock_.now();
      const MapSet readable_now = readable(asking->second);
      // Its rights may have changed while the place was looked for.
      leave_out_others(readable_now, &answer);
      on_query_answered(client, command,
                        wearers_.narrow(client, readable_now, in_part, std::move(answer), now));
    });
  };
  const Result<GrayImagePtr> small = decode_image(message.small_image);
  if (!small) return done({PlaceVerdict::kNotThere, {}, small.error().message});
  PlaceQuery query;
  query.camera = camera;
  query.view.small.assign(**small);
  query.view.corners = std::move(message.corners);
  query.view.up = message.up;
  query.scope = search.scope;
  query.lockstep = message.lockstep;
  places_->ask(std::move(query), done);
}

void MapService::on_query_answered(const std::string& client_name, wire::CommandId command,
                                   const PlaceAnswer& answer) {
  const auto found = clients_.find(client_name);
  if (found == clients_.end()) return;
  Client& client = found->second;
  client.query_in_work = false;
  log_->debug("{}: place {}: {}", client_name, to_string(answer.verdict), describe(answer));
  tell(client, wire::RelocAnswer{client.id, command, answer});
}

std::shared_ptr<MapRunner> MapService::make_runner(MapId map) {
  MapRunner::Listener listener;
  listener.changed = [this, map](MapRevision revision) {
    post_(
        [this, map, revision = std::move(revision)]() mutable { on_map_changed(map, std::move(revision)); });
  };
  listener.frozen = [this, map](const std::string& why) {
    post_([this, map, why] {
      if (MapEntry* entry = maps_.find(map)) entry->frozen = why;
    });
  };
  listener.rested = [this, map](MapStatistics now) {
    post_([this, map, now = std::move(now)]() mutable {
      MapEntry* entry = maps_.find(map);
      if (entry == nullptr) return;
      memory_freed_ = memory_freed_ || now.without_images > entry->statistics.without_images;
      maps_.measured(entry, std::move(now));
    });
  };
  return std::make_shared<MapRunner>(MapRunner::Lanes{lanes_.urgent, lanes_.background}, options_.mapping,
                                     store_, std::move(listener), options_.clock, log_, options_.work_times);
}

void MapService::on_map_changed(MapId map, MapRevision revision) {
  MapEntry* entry = maps_.find(map);
  if (entry == nullptr) return;  // deleted meanwhile
  if (entry->seeding) {
    entry->undecided = std::move(revision);
    return;
  }
  const MapSnapshotPtr snapshot = revision.snapshot;
  if (entry->snapshot != nullptr && snapshot->epoch < entry->snapshot->epoch)
    return;  // from before a roll-back
  maps_.show(entry, snapshot, std::move(revision.statistics));
  entry->used_at = clock_.now();
  // From here, not from the map's queue: a map that has gone does not come back, and no verdict is ahead.
  if (entry->runner != nullptr)
    places_->report(snapshot, std::move(revision.views), std::move(revision.indexed),
                    std::move(revision.offered));
  move_labels(map, *entry);
  info_due_[map] = true;
  {
    const std::scoped_lock lock(mutex_);
    published_[map] = snapshot;
  }
  tell_cameras(map, *entry);
  output_.revised(map, snapshot);
}

void MapService::on_overlap(const Overlap& overlap) {
  const MapEntry* one = maps_.find(overlap.maps.one);
  const MapEntry* other = maps_.find(overlap.maps.other);
  if (one == nullptr || other == nullptr) return;  // deleted meanwhile
  if (!overlaps_.note(overlap, clock_.wall())) return;
  log_->warn(
      "map {} overlaps map {}: {} of its keyframes show what is in that map, {} of that map's what is in "
      "this; `cairnctl maps` keeps count",
      one->name, other->name, overlap.of_one, overlap.of_other);
}

void MapService::forget_map(MapId map) {
  young_.forget(map);
  proposals_.forget(map);
  const MapEntry* entry = maps_.find(map);
  if (entry == nullptr) return;
  const bool was_told = entry->snapshot != nullptr;
  maps_.remove(map);
  if (!was_told) return;
  places_->remove(map);
  info_due_.erase(map);
  {
    const std::scoped_lock lock(mutex_);
    published_.erase(map);
  }
  output_.ended(map);
  for (auto& [name, client] : clients_) unlist_map(map, client);
}

/// Before the revision that names them.
void MapService::tell_cameras(MapId map, const MapEntry& entry) {
  for (const CameraEstimate& estimate : entry.statistics.cameras) {
    const auto name = names_.find(estimate.version.client);
    const auto client = name == names_.end() ? clients_.end() : clients_.find(name->second);
    if (client != clients_.end() && client->second.connected &&
        options_.access->may_read(client->second.principal(), map))
      tell_camera({map, entry.snapshot->epoch}, estimate, client->second);
  }
}

void MapService::tell_camera(std::pair<MapId, Epoch> where, const CameraEstimate& estimate, Client& client) {
  const auto& [map, epoch] = where;
  const CameraVersion& version = estimate.version;
  const std::pair now(epoch, version.version);
  auto& told = client.cameras_told[{map, version.camera}];
  if (told == now) return;
  const CameraParameters& parameters = estimate.camera->parameters();
  const Status written = tell(
      client, wire::CameraEstimate{version.client, version.camera, map, epoch, version.version, parameters,
                                   sigma_of_values({parameters, estimate.sigma[0], estimate.sigma[1]}),
                                   estimate.frozen, estimate.cannot_be_known});
  if (written) told = now;  // else with the next tick
}

void MapService::forget_cameras(MapId map, Client& client) {
  for (auto told = client.cameras_told.lower_bound({map, 0});
       told != client.cameras_told.end() && told->first.first == map;
       told = client.cameras_told.erase(told)) {
    tell(client, EstimateDropped{client.id, told->first.second, map});
  }
}

std::string MapService::why_memory_is_full(size_t more) const {
  constexpr size_t kMegabyte = 1'000'000;
  const size_t bytes = maps_.bytes();
  if (bytes + more < options_.max_memory_bytes) return {};
  std::string why = "the server is full: its maps take " + std::to_string(bytes / kMegabyte) + " MB";
  if (more > 0) why += ", and this one, which rests, needs " + std::to_string(more / kMegabyte) + " MB more";
  return why + " (--max-memory)";
}

std::string MapService::why_map_is_full(const MapEntry& entry) const {
  const size_t keyframes = entry.statistics.keyframes;
  if (keyframes + static_cast<size_t>(entry.offers_in_work) >= options_.max_keyframes) {
    return "the map has " + std::to_string(keyframes) +
           " keyframes, which is all it may have (--max-keyframes)";
  }
  return why_memory_is_full(bytes_to_wake(entry));
}

std::string MapService::why_full() const {
  if (maps_.all().size() >= options_.max_maps)
    return "the server is full: " + std::to_string(maps_.all().size()) + " maps (--max-maps)";
  return why_memory_is_full();
}

std::string MapService::why_maker_is_full(const Client& client) const {
  const auto made =
      std::ranges::count_if(maps_.all(), [&](const auto& map) { return map.second.maker == client.name; });
  if (static_cast<size_t>(made) < options_.max_maps_per_client) return {};
  return "this client has made " + std::to_string(made) +
         " of the maps here, which is all that one may have (--max-maps-per-client)";
}

void MapService::write_verdicts(Client& client) {
  if (!client.connected || !client.offer_gate.session()) return;
  wire::OfferVerdict offers = client.offer_gate.verdict(client.id);
  if (client.lockstep_refused) offers.recent = {notice_to_process(kNoLockstep)};
  tell(client, offers);
  if (client.seed_gate.verdict().command.seq != 0) {
    tell(client, client.seed_gate.verdict());
  }
  tell(client, client.request_gate.verdict(client.id));
}

void MapService::list_map(MapId map, const MapEntry& entry) {
  info_due_.erase(map);
  for (auto& [name, client] : clients_) list_map(map, entry, client);
}

void MapService::list_map(MapId map, const MapEntry& entry, Client& client) {
  if (!client.connected) return;
  const Right right = options_.access->in_map(client.principal(), map).right;
  if (right < Right::kRead) return;
  client.maps_told.insert(map);
  wire::MapInfo info = make_map_info(options_.server, map, entry, right);
  info.takes_proposals = takes_proposals(client, map, entry);
  tell(client, info);
}

MapSet MapService::readable(const Client& client) const {
  std::vector<MapId> served;
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.snapshot) served.push_back(map);
  }
  return options_.access->readable(client.principal(), served);
}

Status MapService::tell(const Client& client, const ClientEvent& event) {
  // Its readers of maps may be there before and after those that it is told by.
  if (!client.connected && !std::holds_alternative<MapUnlisted>(event)) return {};
  Status told = output_.tell(client.name, with_fitting_words(event));
  if (!told && output_trouble_.due(clock_.now())) log_->error("{}: {}", client.name, told.error().message);
  return told;
}

}  // namespace cairn
