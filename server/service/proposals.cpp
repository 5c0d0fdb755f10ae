// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <exception>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/utc.h"
#include "server/service/admin_reply.h"
#include "server/service/admin_request.h"
#include "server/service/map_service.h"
#include "server/service/proposal_judge.h"

/// Keyframes of who may not add them, kept aside until an operator decides. They are looked at in the lane
/// that stands back for all others, on what is published of the map; the map's queue hears of one when an
/// operator accepts it.
namespace cairn {
namespace {

using asked::number_of;
using asked::text_of;
using nlohmann::json;

constexpr size_t kMostInWork = 8;  ///< their pictures are in memory meanwhile

json place_of(const Eigen::Vector3d& place) {
  return {place.x(), place.y(), place.z()};
}

json describe(MapId map, const std::string& map_name, const ProposalSummary& proposal) {
  const SE3& pose = proposal.camera_from_map;
  return {{"id", proposal_id(map, proposal.number)},
          {"number", proposal.number},
          {"map", to_hex(map.bytes)},
          {"map_name", map_name},
          {"client", proposal.client},
          {"why", proposal.why},
          {"received", to_utc(proposal.received)},
          {"time", to_utc(proposal.time)},
          {"position", place_of(pose.center())},
          {"direction", place_of(pose.rotation_matrix().row(2))},
          {"expected", proposal.expected},
          {"found", proposal.found},
          {"bytes", proposal.bytes}};
}

/// x, y and whether it was found, of each.
json describe(const std::vector<ExpectedPoint>& points) {
  json told = json::array();
  for (const ExpectedPoint& p : points)
    told.push_back({std::lround(p.pixel.x()), std::lround(p.pixel.y()), p.found ? 1 : 0});
  return told;
}

}  // namespace

// ---- from clients

bool MapService::takes_proposals(const Client& client, MapId map, const MapEntry& entry) const {
  return store_ != nullptr && entry.runner != nullptr && !entry.rolling_back && !entry.leaving &&
         options_.access->may_propose(client.principal(), map);
}

std::string MapService::why_aside(const wire::KeyframeOffer& offer, const MapEntry& entry,
                                  const Ruling& ruling) const {
  if (offer.as_proposal) return "proposed by who only reads";
  if (ruling.right < Right::kAdd) return ruling.reason;
  // The map maker judges by the pose that it finds itself; what lies clearly outside need not wait for that.
  const KeyframePose* reference = offer.reference_command == 0 && offer.epoch == entry.snapshot->epoch
                                      ? entry.snapshot->find(offer.reference)
                                      : nullptr;
  if (!ruling.extent || reference == nullptr) return {};
  const Eigen::Vector3d center = (offer.camera_from_reference * reference->camera_from_map).center();
  return contains(*ruling.extent, center) ? std::string() : outside(*ruling.extent, center);
}

void MapService::propose(Client* client, const MapEntry& entry, wire::KeyframeOffer offer,
                         const AnnouncedCamera& camera, std::string why) {
  wire::OfferOutcome outcome;
  outcome.seq = offer.command.seq;
  outcome.map = offer.map;
  const SessionId session = offer.command.session;
  const auto refuse = [&](wire::OfferDecision decision, std::string reason) {
    outcome.decision = decision;
    outcome.reason = std::move(reason);
    on_offer_decided(client->name, session, outcome);
  };
  if (camera.doubt)
    return refuse(wire::OfferDecision::kNoRight,
                  "a proposal is taken of a calibrated camera only; `cairn-track calibrate` makes it one");
  std::string full = store_->trouble();
  if (full.empty()) full = proposals_.why_full();
  if (!full.empty()) return refuse(wire::OfferDecision::kFull, std::move(full));
  if (proposals_in_work_ >= kMostInWork)
    return refuse(wire::OfferDecision::kBusy, "more proposals come than can be looked at");
  // A replay does not go by this clock.
  std::string not_now = offer.lockstep ? "" : proposals_.why_not_now(client->name, clock_.now());
  if (!not_now.empty()) {
    if (!offer.as_proposal) return refuse(wire::OfferDecision::kNoRight, std::move(why));
    return refuse(wire::OfferDecision::kBusy, std::move(not_now));
  }
  ++proposals_in_work_;
  const Pending pending = client->pending_offers.add({PendingOffers::Kind::kProposal, offer.map, {}},
                                                     offer.image.bytes.size(), waiting_bytes_);
  Executor& lane = offer.lockstep ? lanes_.urgent : lanes_.idle;  // who replays a recording waits for it
  lane.submit([this, name = client->name, session, outcome, snapshot = entry.snapshot, camera = camera.camera,
               offer = std::move(offer), why = std::move(why), pending] {
    ProposalJudgement judged{wire::OfferDecision::kDamaged, "internal error; the server's log says more", {}};
    try {
      judged = judge_proposal(*snapshot, *camera, offer);
    } catch (const std::exception& problem) {  // memory, a library
      log_->error("internal error in a proposal of {}: {}", name, problem.what());
    }
    judged.kept.record.summary.client = name;
    judged.kept.record.summary.why = why;
    post_([this, session, outcome, judged = std::move(judged), pending]() mutable {
      on_proposal_judged(session, outcome, std::move(judged), pending);
    });
  });
}

void MapService::on_proposal_judged(SessionId session, wire::OfferOutcome outcome, ProposalJudgement judged,
                                    const Pending& pending) {
  --proposals_in_work_;
  ProposalSummary& summary = judged.kept.record.summary;
  const std::string name = summary.client;
  outcome.decision = judged.decision;
  outcome.reason = judged.reason;
  const MapEntry* entry = maps_.find(outcome.map);
  const auto client = clients_.find(name);
  if (judged.decision == wire::OfferDecision::kKeptAside) {
    if (entry == nullptr || entry->snapshot == nullptr) {
      outcome.decision = wire::OfferDecision::kUnknownMap;
      outcome.reason = "this server does not know the map";
    } else if (entry->rolling_back) {
      outcome.decision = wire::OfferDecision::kBusy;
      outcome.reason = kRollingBack;
    } else if (pending->is_withdrawn() || client == clients_.end() ||
               !takes_proposals(client->second, outcome.map, *entry)) {
      outcome.decision = wire::OfferDecision::kNoRight;
      outcome.reason = kNoProposals;
    } else if (const ProposalSummary* other = proposals_.find_alike(outcome.map, summary)) {
      outcome.decision = wire::OfferDecision::kTooClose;
      outcome.reason = "proposal " + proposal_id(outcome.map, other->number) + " shows the same already";
    }
  }
  if (outcome.decision != wire::OfferDecision::kKeptAside) return on_offer_decided(name, session, outcome);
  keep_proposal(session, std::move(outcome), std::move(judged.kept), pending);
}

/// With what was decided on the offer: sent again after a restart, it is answered and not kept twice.
void MapService::keep_proposal(SessionId session, wire::OfferOutcome outcome, KeptProposal kept,
                               const Pending& pending) {
  ProposalSummary& summary = kept.record.summary;
  summary.received = clock_.wall();
  outcome.reason = "kept aside as a proposal: " + summary.why;
  const ProposalBook::Room room = proposals_.add(outcome.map, summary);
  summary.number = room.number;
  const std::string name = summary.client;
  MapUpdate update;
  update.decisions.push_back({name,
                              session,
                              outcome.seq,
                              CommandKind::kOffer,
                              static_cast<uint8_t>(outcome.decision),
                              outcome.reason,
                              {},
                              summary.received,
                              {},
                              0});
  update.proposals.push_back(std::move(kept));
  for (const ProposalSummary& gone : room.gone) update.removed_proposals.push_back(gone.number);
  const MapId map = outcome.map;
  store_->write(map, std::move(update), [this, name, session, outcome, room, pending](const Status& written) {
    post_([this, name, session, outcome, room, pending, written]() mutable {
      const MapEntry* entry = maps_.find(outcome.map);
      if (written && pending->is_withdrawn() && entry != nullptr && !entry->rolling_back) {
        remove_proposals(outcome.map, {room.number});
        outcome.decision = wire::OfferDecision::kNoRight;
        outcome.reason = kNoProposals;
      } else if (!written) {
        proposals_.take_back(outcome.map, room);
        outcome.decision = wire::OfferDecision::kFull;
        outcome.reason = written.error().message;
      } else {
        log_->info("{}: proposal {} kept aside", name, proposal_id(outcome.map, room.number));
      }
      on_offer_decided(name, session, outcome);
    });
  });
}

void MapService::drop_old_proposals() {
  if (store_ == nullptr) return;
  for (auto& [map, numbers] : proposals_.too_old(clock_.wall())) {
    const MapEntry* entry = maps_.find(map);
    if (entry == nullptr || entry->rolling_back) continue;  // later
    for (const uint64_t number : numbers)
      log_->info("proposal {} is dropped: nobody has decided of it for long", proposal_id(map, number));
    remove_proposals(map, numbers);
  }
}

void MapService::remove_proposals(MapId map, const std::vector<uint64_t>& numbers) {
  for (const uint64_t number : numbers) proposals_.remove(map, number);
  MapUpdate update;
  update.removed_proposals = numbers;
  store_->write(map, std::move(update), {});
}

// ---- for operators

std::optional<MapService::NamedProposal> MapService::named_proposal(const std::string& id) const {
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.snapshot == nullptr) continue;
    for (const auto& [number, proposal] : proposals_.of(map))
      if (proposal_id(map, number) == id) return NamedProposal{map, number};
  }
  return std::nullopt;
}

bool MapService::decides_proposals(const json& request, const AdminAnswer& answer) {
  const std::string verb = text_of(request, "verb");
  if (verb == "proposals") {
    list_proposals(request, answer);
    return true;
  }
  const bool is_one = verb == "proposal-show" || verb == "proposal-picture" || verb == "proposal-accept" ||
                      verb == "proposal-drop";
  if (!is_one) return false;
  const std::string id = text_of(request, "proposal");
  const auto which = named_proposal(id);
  if (!which) {
    answer(refusal(ErrorCode::kNotFound,
                   "there is no proposal " + id + "; `cairnctl proposals` lists those that wait"));
  } else if (verb == "proposal-show") {
    show_proposal(*which, answer);
  } else if (verb == "proposal-picture") {
    send_picture(*which, number_of(request, "offset"), answer);
  } else if (verb == "proposal-drop") {
    drop_proposal(*which, answer);
  } else {
    accept_proposal(*which, answer);
  }
  return true;
}

void MapService::list_proposals(const json& request, const AdminAnswer& answer) {
  const std::string wanted = text_of(request, "map");
  const std::string client = text_of(request, "client");
  const std::pair after(text_of(request, "after_map"), number_of(request, "after"));
  if (!wanted.empty() && find_map(wanted).second == nullptr)
    return answer_without_map("proposals", wanted, answer);
  ReplyPage page{"proposals"};
  for (const auto& [map, entry] : maps_.all()) {
    const std::string id = to_hex(map.bytes);
    if (entry.snapshot == nullptr || (!wanted.empty() && wanted != entry.name && wanted != id)) continue;
    for (const auto& [number, proposal] : proposals_.of(map)) {
      if (std::pair(id, number) <= after || (!client.empty() && client != proposal.client)) continue;
      if (!page.add("proposals", describe(map, entry.name, proposal))) return answer(success(page.content()));
    }
  }
  answer(success(page.content()));
}

void MapService::read_proposal(const NamedProposal& which, const AdminAnswer& answer,
                               std::function<void(KeptProposal kept)> use) {
  store_->run([this, which, answer, use = std::move(use)](Store& store) {
    auto kept = store.read_proposal(which.map, which.number);
    post_([answer, use, kept = std::move(kept)]() mutable {
      if (!kept) return answer(refusal(kept.error()));
      use(std::move(*kept));
    });
  });
}

void MapService::show_proposal(const NamedProposal& which, const AdminAnswer& answer) {
  read_proposal(which, answer, [this, which, answer](KeptProposal kept) {
    const MapEntry* entry = maps_.find(which.map);
    if (entry == nullptr) return answer(refusal(ErrorCode::kNotFound, "the map has gone meanwhile"));
    json told = describe(which.map, entry->name, kept.record.summary);
    told["picture_bytes"] = kept.picture.size();
    told["measured"] = kept.record.measurements.size();
    lanes_.idle.submit([this, answer, told = std::move(told), kept = std::move(kept),
                        snapshot = entry->snapshot, epochs = entry->epochs]() mutable {
      const auto points = points_in(*snapshot, epochs, kept);
      if (points) {
        told["expected_now"] = points->size();
        told["found_now"] =
            std::count_if(points->begin(), points->end(), [](const ExpectedPoint& p) { return p.found; });
        told["points"] = describe(*points);
      } else {
        told["problem"] = points.error().message;
      }
      post_([answer, told = std::move(told)] { answer(success(told)); });
    });
  });
}

void MapService::send_picture(const NamedProposal& which, uint64_t offset, const AdminAnswer& answer) {
  read_proposal(which, answer, [answer, offset](const KeptProposal& kept) {
    const size_t from = std::min<size_t>(offset, kept.picture.size());
    const size_t size = std::min(wire::kMaxAdminData, kept.picture.size() - from);
    wire::AdminReply reply = success({{"bytes", kept.picture.size()}});
    reply.data.assign(kept.picture.begin() + static_cast<std::ptrdiff_t>(from),
                      kept.picture.begin() + static_cast<std::ptrdiff_t>(from + size));
    answer(std::move(reply));
  });
}

void MapService::drop_proposal(const NamedProposal& which, const AdminAnswer& answer) {
  if (maps_.find(which.map)->rolling_back) return answer(refusal(ErrorCode::kRefused, kRollingBack));
  MapUpdate update;
  update.removed_proposals.push_back(which.number);
  store_->write(which.map, std::move(update), [this, which, answer](const Status& written) {
    post_([this, which, answer, written] {
      if (!written) return answer(refusal(written.error()));
      proposals_.remove(which.map, which.number);
      answer(success({{"id", proposal_id(which.map, which.number)}}));
    });
  });
}

std::string MapService::why_not_accepted(MapId map, const MapEntry& entry) const {
  if (std::string frozen = options_.access->why_frozen(map); !frozen.empty())
    return frozen + "; `cairnctl map " + entry.name + " unfreeze` lets it grow again";
  if (!entry.frozen.empty()) return "the map takes nothing: " + entry.frozen;
  if (entry.leaving) return "the map is being deleted";
  if (entry.rolling_back) return kRollingBack;
  if (std::string trouble = store_->trouble(); !trouble.empty()) return trouble;
  return why_map_is_full(entry);
}

/// The map maker judges it as any other offer, by the map as it is now.
void MapService::accept_proposal(const NamedProposal& which, const AdminAnswer& answer) {
  if (std::string why = why_not_accepted(which.map, *maps_.find(which.map)); !why.empty())
    return answer(refusal(ErrorCode::kRefused, std::move(why)));
  read_proposal(which, answer, [this, which, answer](KeptProposal kept) {
    MapEntry* entry = maps_.find(which.map);
    const auto camera = make_camera(kept.record.camera);
    if (entry == nullptr) return answer(refusal(ErrorCode::kNotFound, "the map has gone meanwhile"));
    if (!camera) return answer(refusal(camera.error()));
    OfferJob job;
    const ProposalRecord& record = kept.record;
    job.origin = {record.summary.client,
                  {record.summary.session, record.summary.seq},
                  which.number,
                  record.summary.received};
    job.input.camera = *camera;
    job.input.time = record.summary.time;
    job.input.reference = record.reference;
    job.input.camera_from_reference = record.camera_from_reference;
    job.input.measurements = record.measurements;
    job.input.candidates = record.candidates;
    job.input.up = record.up;
    job.input.still = still_mask_of(record.camera.width, record.camera.height, record.still_mask);
    job.epoch = record.summary.epoch;
    job.image = {wire::ImageEncoding::kJpeg, static_cast<uint32_t>(record.camera.width),
                 static_cast<uint32_t>(record.camera.height), std::move(kept.picture)};  // PNG is known, too
    entry->used_at = clock_.now();
    entry->runner->offer(std::move(job), [this, which, answer, client = record.summary.client,
                                          runner = entry->runner](const OfferJudgement& judgement) {
      post_([this, which, answer, client, runner, judgement] {
        MapEntry* judged = maps_.find(which.map);
        const bool is_same = judged != nullptr && judged->runner == runner;
        if (is_same) maps_.end_offer(judged);
        on_proposal_decided(which, client, judgement, is_same && !judged->rolling_back, answer);
      });
    });
    maps_.begin_offer(entry);
  });
}

void MapService::on_proposal_decided(const NamedProposal& which, const std::string& client,
                                     const OfferJudgement& judgement, bool is_final,
                                     const AdminAnswer& answer) {
  const std::string id = proposal_id(which.map, which.number);
  if (judgement.decision == wire::OfferDecision::kAccepted) {
    proposals_.remove(which.map, which.number);
    young_.forget(which.map);
    log_->info("proposal {} of {} is keyframe {} of its map", id, client, judgement.keyframe.value);
    return answer(success({{"id", id},
                           {"map", to_hex(which.map.bytes)},
                           {"client", client},
                           {"keyframe", judgement.keyframe.value}}));
  }
  if (judgement.decision != wire::OfferDecision::kStale || !is_final)
    return answer(refusal(ErrorCode::kRefused, judgement.reason + "; it stays until it is dropped"));
  // What it was measured against does not come back.
  drop_proposal(which, [answer, why = judgement.reason](const wire::AdminReply& dropped) {
    answer(refusal(ErrorCode::kRefused, dropped.result == 0 ? why + "; it has been dropped" : why));
  });
}

}  // namespace cairn
