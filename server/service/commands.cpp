// SPDX-License-Identifier: Apache-2.0
#include "server/service/commands.h"

#include <utility>

#include "server/service/proposal_rule.h"
#include "server/service/waiting_limit.h"

namespace cairn {
namespace {

size_t image_bytes(const wire::MapSeed& message) {
  return message.first_image.bytes.size() + message.second_image.bytes.size();
}

/// A job for the map's queue, with those members set that seeds and offers have in common.
template <typename Job, typename Message>
Job begun_job(const Client& client, const AnnouncedCamera& camera, const Ruling& ruling,
              const Message& message) {
  Job job;
  job.origin = {client.name, message.command};
  job.input.camera = camera.camera;
  job.input.prior = camera.prior_of({client.id, message.camera, message.camera_version});
  job.input.still = still_mask_of(camera.camera->width(), camera.camera->height(), message.still_mask);
  job.input.extent = ruling.extent;
  job.lockstep = message.lockstep;
  return job;
}

SeedJob job_of(const Client& client, const AnnouncedCamera& camera, const Ruling& ruling,
               wire::MapSeed message) {
  auto job = begun_job<SeedJob>(client, camera, ruling, message);
  job.input.first_time = message.first_time;
  job.input.second_time = message.second_time;
  job.input.trails = std::move(message.trails);
  job.input.second_from_first = message.second_from_first;
  job.input.second_up = message.second_up;
  job.first_image = std::move(message.first_image);
  job.second_image = std::move(message.second_image);
  return job;
}

OfferJob job_of(const Client& client, const AnnouncedCamera& camera, const Ruling& ruling,
                wire::KeyframeOffer message) {
  auto job = begun_job<OfferJob>(client, camera, ruling, message);
  job.input.time = message.time;
  job.input.reference = message.reference;
  job.reference_command = message.reference_command;
  job.input.camera_from_reference = message.camera_from_reference;
  job.input.measurements = std::move(message.measurements);
  job.input.candidates = std::move(message.candidates);
  job.input.up = message.up;
  job.input.adds_only = ruling.right < Right::kWrite;
  job.epoch = message.epoch;
  job.image = std::move(message.image);
  return job;
}

}  // namespace

void Commands::take(const Principal& who, wire::MapSeed message) {
  Client& client = clients_.of(who);
  if (!sessions_.holds(client, message.command.session)) return;  // it will be sent again
  if (sessions_.refuses_lockstep(client, message.lockstep)) return;
  const auto rate = client.rates.judge(ClientRates::Kind::kSeed, context_.now(), message.lockstep);
  if (rate == ClientRates::Judgement::kPassOver) return;
  const AnnouncedCamera* camera = client.cameras.find(message.camera, message.camera_version);
  if (client.seed_in_work || (camera == nullptr && may_yet_come(client, context_.now()))) return;
  switch (client.seed_gate.admit(message.command.seq)) {
    case SeedGate::Admission::kNew:
      break;
    case SeedGate::Admission::kRepeated:
      return clients_.write_verdicts(client);
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
  const Ruling ruling = context_.access().on_creating(client.principal());
  if (ruling.right < Right::kWrite) {
    clients_.note_refused(client, "map make", {}, ruling.reason);
    return refuse(ruling.reason + "; `cairnctl rights explain " + client.name + "` says what decides");
  }
  if (std::string why = why_no_map(client); !why.empty()) return refuse(std::move(why));
  if (std::string why = why_too_much_waits(context_, *clients_.waiting_bytes(), image_bytes(message));
      !why.empty())
    return refuse(std::move(why));
  make_map(client, *camera, ruling, std::move(message), verdict);
}

std::string Commands::why_no_map(const Client& client) const {
  if (std::string why = capacity_.why_full(); !why.empty()) return why;
  if (std::string why = capacity_.why_maker_is_full(client.name); !why.empty()) return why;
  return context_.store ? context_.store->trouble() : std::string();
}

void Commands::make_map(Client& client, const AnnouncedCamera& camera, const Ruling& ruling,
                        wire::MapSeed message, wire::SeedVerdict verdict) {
  client.seed_in_work = true;
  const bool may_die_young = !message.lockstep && message.map_name.empty();
  const MapId map = message.lockstep ? maps_.array().ids().repeatable(message) : maps_.array().ids().next();
  const std::string name = maps_.array().names().free(message.map_name);
  const SessionId session = message.command.session;
  const size_t bytes = image_bytes(message);
  SeedJob job = job_of(client, camera, ruling, std::move(message));
  job.input.map = map;
  job.input.map_name = name;
  job.input.epoch = {context_.options.start_count};
  job.pending = client.pending_offers.add({PendingOffers::Kind::kSeed, map, ruling.extent}, bytes,
                                          clients_.waiting_bytes());
  const auto pending = job.pending;
  auto runner = maps_.make_runner(map);
  MapEntry& entry = maps_.array().add(map, MapEntry{name, runner, {}, {}, {}});
  entry.seeding = true;
  entry.maker = client.name;
  verdict.map = map;
  if (may_die_young) maps_.young().made(map, client.name, session);
  runner->start(std::move(job), [this, name = client.name, verdict, pending](Result<SeedResult> result,
                                                                             MapSnapshotPtr snapshot) {
    context_.post([this, name, verdict, pending, result = std::move(result), snapshot = std::move(snapshot)] {
      on_seed_judged(name, verdict, result, snapshot, pending);
    });
  });
}

void Commands::on_seed_judged(const std::string& client_name, const wire::SeedVerdict& verdict,
                              const Result<SeedResult>& result, const MapSnapshotPtr& snapshot,
                              const Pending& pending) {
  if (!result) return on_seed_decided(client_name, verdict, result, snapshot);
  const auto settle = [this, client_name, verdict, result, snapshot, pending] {
    if (!pending->is_withdrawn()) return on_seed_decided(client_name, verdict, result, snapshot);
    take_out(verdict.map);
    on_seed_decided(client_name, verdict, fail(ErrorCode::kRefused, kSeedWithdrawn), nullptr);
  };
  if (pending->is_withdrawn()) return settle();
  let_maker_write(client_name, verdict.map, settle);
}

/// Lets the maker of a map write in it, then calls `then`. This comes before the verdict, so that none of the
/// maker's keyframes is refused for want of the right.
void Commands::let_maker_write(const std::string& client_name, MapId map, const std::function<void()>& then) {
  const Client* client = clients_.find(client_name);
  const MapEntry* entry = maps_.array().find(map);
  if (client == nullptr || entry == nullptr ||
      context_.access().in_map(client->principal(), map).right >= Right::kWrite)
    return then();
  context_.site.let_maker_write(client_name, map, entry->name, [this, client_name, then](const Status& kept) {
    if (!kept)
      context_.log->error("{} may not write in the map it has made: {}", client_name, kept.error().message);
    then();
  });
}

void Commands::take_out(MapId map) {
  if (const MapEntry* entry = maps_.array().find(map)) {
    entry->runner->retire();
    context_.site.forget(map, entry->name);
  }
  if (context_.store == nullptr) return;
  context_.store->run([map, log = context_.log](Store& store) {
    const Status gone = store.undo_import(map);
    if (!gone) log->error("a map that was not to be made is still there: {}", gone.error().message);
  });
}

void Commands::on_seed_decided(const std::string& client_name, wire::SeedVerdict verdict,
                               const Result<SeedResult>& result, const MapSnapshotPtr& snapshot) {
  MapEntry* entry = maps_.array().find(verdict.map);
  verdict.accepted = result && entry != nullptr && entry->undecided;
  if (verdict.accepted) {
    verdict.epoch = snapshot->epoch;
    verdict.revision = snapshot->revision;
    verdict.first_keyframe = result->first_keyframe;
    verdict.second_keyframe = result->second_keyframe;
    verdict.points = result->points;
    entry->plane_aligned = result->plane_aligned;
    entry->seeding = false;
    maps_.change(verdict.map, *std::exchange(entry->undecided, {}));
    context_.log->info("{}: {} made, {} points{}", client_name, entry->name, snapshot->point_count(),
                       result->plane_aligned ? ", on its plane" : "");
    news_.tell(verdict.map, *entry);
    clients_.note_done(client_name, "map make", "map " + entry->name);
  } else {
    verdict.reason = result ? "internal error; the server's log says more" : result.error().message;
    tell_no_map(client_name, verdict.reason);
    maps_.forget(verdict.map);
    verdict.map = {};
  }
  Client* client = clients_.find(client_name);
  if (client == nullptr) return;
  client->seed_in_work = false;
  if (client->seed_gate.decide(verdict)) clients_.write_verdicts(*client);
}

/// A tracker that is refused begins again at once.
void Commands::tell_no_map(const std::string& client_name, const std::string& why) {
  Client* client = clients_.find(client_name);
  const auto said = client == nullptr ? why : client->seeds_refused.say(why, context_.now());
  if (said) context_.log->info("{}: no map made: {}", client_name, *said);
}

void Commands::take(const Principal& who, wire::KeyframeOffer message) {
  Client& client = clients_.of(who);
  if (!sessions_.holds(client, message.command.session)) return;
  if (sessions_.refuses_lockstep(client, message.lockstep)) return;
  const auto rate = client.rates.judge(ClientRates::Kind::kKeyframe, context_.now(), message.lockstep);
  if (rate == ClientRates::Judgement::kPassOver) return;
  const AnnouncedCamera* camera = client.cameras.find(message.camera, message.camera_version);
  if (camera == nullptr && may_yet_come(client, context_.now())) return;
  const auto refuse = [&](wire::OfferDecision decision, std::string reason) {
    wire::OfferOutcome outcome;
    outcome.seq = message.command.seq;
    outcome.map = message.map;
    outcome.decision = decision;
    outcome.reason = std::move(reason);
    on_offer_decided(client.name, message.command.session, std::move(outcome));
  };
  switch (client.offer_gate.admit(message.command.seq)) {
    case OfferGate::Admission::kNew:
      break;
    case OfferGate::Admission::kNoCredit:
      return refuse(wire::OfferDecision::kBusy, "more offers under way than the credit allows");
    case OfferGate::Admission::kRepeated:
      return clients_.write_verdicts(client);
    case OfferGate::Admission::kInFlight:
    case OfferGate::Admission::kGap:
      return;
  }
  if (rate == ClientRates::Judgement::kRefuse)
    return refuse(wire::OfferDecision::kBusy, client.rates.why(ClientRates::Kind::kKeyframe));
  if (camera == nullptr)
    return refuse(wire::OfferDecision::kDamaged, unknown_camera(message.camera, message.camera_version));
  client.camera_missed_at.reset();
  pass_on(client, *camera, std::move(message));
}

void Commands::pass_on(Client& client, const AnnouncedCamera& camera, wire::KeyframeOffer message) {
  const SessionId session = message.command.session;
  wire::OfferOutcome outcome;
  outcome.seq = message.command.seq;
  outcome.map = message.map;
  const auto refuse_as = [&](wire::OfferDecision decision, std::string reason) {
    outcome.decision = decision;
    outcome.reason = std::move(reason);
    on_offer_decided(client.name, session, outcome);
  };
  MapEntry* entry = maps_.array().find(message.map);
  const Ruling ruling = context_.access().in_map(client.principal(), message.map);
  if (entry == nullptr || entry->snapshot == nullptr || ruling.right == Right::kNone) {
    if (entry != nullptr) note_refused_offer(client, *entry, ruling.reason);
    return refuse_as(wire::OfferDecision::kUnknownMap, "this server does not know the map");
  }
  if (takes_proposals(context_, client, message.map, *entry)) {
    if (std::string why = why_aside(message, *entry, ruling); !why.empty()) {
      return proposals_.propose(client, *entry, std::move(message), camera, std::move(why),
                                [this, name = client.name, session](wire::OfferOutcome decided) {
                                  on_offer_decided(name, session, std::move(decided));
                                });
    }
  }
  if (auto refusal = refuse(message, *entry, ruling))
    return refuse_as(refusal->first, std::move(refusal->second));
  OfferJob job = job_of(client, camera, ruling, std::move(message));
  job.pending = client.pending_offers.add({PendingOffers::Kind::kKeyframe, outcome.map, ruling.extent},
                                          job.image.bytes.size(), clients_.waiting_bytes());
  outcome.epoch = entry->snapshot->epoch;
  entry->used_at = context_.now();
  offer(client.name, entry, std::move(job), std::move(outcome));
}

Commands::Refusal Commands::refuse(const wire::KeyframeOffer& message, const MapEntry& entry,
                                   const Ruling& ruling) const {
  const auto because = [](wire::OfferDecision decision, std::string reason) {
    return Refusal({decision, std::move(reason)});
  };
  if (message.as_proposal) return because(wire::OfferDecision::kNoRight, kNoProposals);
  if (ruling.right < Right::kAdd) return because(wire::OfferDecision::kNoRight, ruling.reason);
  if (entry.runner == nullptr) return because(wire::OfferDecision::kNoRight, "this map takes no keyframes");
  if (std::string why = capacity_.why_map_is_full(entry); !why.empty())
    return because(wire::OfferDecision::kFull, std::move(why));
  if (std::string why = why_too_much_waits(context_, *clients_.waiting_bytes(), message.image.bytes.size());
      !why.empty())
    return because(wire::OfferDecision::kBusy, std::move(why));
  return std::nullopt;
}

void Commands::offer(const std::string& client_name, MapEntry* entry, OfferJob job,
                     wire::OfferOutcome outcome) {
  const SessionId session = job.origin.command.session;
  const auto done = [this, name = client_name, session, outcome, arrived = context_.now(),
                     runner = entry->runner](OfferJudgement judgement) mutable {
    outcome.decision = judgement.decision;
    outcome.reason = std::move(judgement.reason);
    outcome.keyframe = judgement.keyframe;
    outcome.revision = judgement.revision;
    context_.post([this, name, session, outcome, arrived, runner] {
      MapEntry* judged = maps_.array().find(outcome.map);
      if (judged != nullptr) {
        judged->offer_times.note(context_.now() - arrived,
                                 outcome.decision == wire::OfferDecision::kAccepted);
      }
      if (judged != nullptr && judged->runner == runner) maps_.array().end_offer(judged);
      on_offer_decided(name, session, outcome);
    });
  };
  entry->runner->offer(std::move(job), done);
  maps_.array().begin_offer(entry);
}

void Commands::on_offer_decided(const std::string& client_name, SessionId session,
                                wire::OfferOutcome outcome) {
  context_.log->debug(
      "{}: offer {}: {}", client_name, outcome.seq,
      outcome.reason.empty() ? "keyframe " + std::to_string(outcome.keyframe.value) : outcome.reason);
  if (outcome.decision == wire::OfferDecision::kAccepted) maps_.young().forget(outcome.map);
  Client* client = clients_.find(client_name);
  if (client == nullptr) return;
  const MapEntry* entry = maps_.array().find(outcome.map);
  if (outcome.decision == wire::OfferDecision::kNoRight && entry != nullptr)
    note_refused_offer(*client, *entry, outcome.reason);
  client->offer_gate.decide(session, std::move(outcome));
  clients_.write_verdicts(*client);
}

void Commands::note_refused_offer(Client& client, const MapEntry& entry, const std::string& why) {
  clients_.note_refused(client, "keyframe offer", "map " + entry.name, why);
}

}  // namespace cairn
