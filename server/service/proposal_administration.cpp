// SPDX-License-Identifier: Apache-2.0
#include "server/service/proposal_administration.h"

#include <algorithm>
#include <utility>

#include "server/service/proposal_judge.h"

namespace cairn {
namespace {

/// More than fit into a page: each takes some 300 bytes at least.
constexpr size_t kMostTold = 250;

/// The job of an accepted proposal: that of any other offer of its client, with what was kept.
OfferJob accepted_job(uint64_t number, const CameraPtr& camera, KeptProposal kept) {
  const ProposalRecord& record = kept.record;
  const auto width = record.camera.width;
  const auto height = record.camera.height;
  OfferJob job;
  job.origin = {
      record.summary.client, {record.summary.session, record.summary.seq}, number, record.summary.received};
  job.input.camera = camera;
  job.input.time = record.summary.time;
  job.input.reference = record.reference;
  job.input.camera_from_reference = record.camera_from_reference;
  job.input.measurements = record.measurements;
  job.input.candidates = record.candidates;
  job.input.up = record.up;
  job.input.still = still_mask_of(width, height, record.still_mask);
  job.epoch = record.summary.epoch;
  job.image = {wire::ImageEncoding::kJpeg, static_cast<uint32_t>(width), static_cast<uint32_t>(height),
               std::move(kept.image)};  // PNG is known, too
  return job;
}

}  // namespace

std::optional<ProposalAdministration::Named> ProposalAdministration::find(const std::string& id,
                                                                          const AdminAnswer& answer) const {
  for (const auto& [map, entry] : maps_.array().all()) {
    if (entry.snapshot == nullptr) continue;
    for (const auto& [number, proposal] : registry_.of(map))
      if (proposal_id(map, number) == id) return Named{map, number};
  }
  answer(refusal(ErrorCode::kNotFound,
                 "there is no proposal " + id + "; `cairnctl proposals` lists those that wait"));
  return std::nullopt;
}

void ProposalAdministration::take(const asked::Proposals& ask, const AdminAnswer& answer) {
  const std::pair after(ask.after_map, ask.after);
  told::Proposals page;
  for (const auto& [map, entry] : maps_.array().all()) {
    const std::string id = to_hex(map.bytes);
    if (entry.snapshot == nullptr || (!ask.map.empty() && ask.map != entry.name && ask.map != id)) continue;
    for (const auto& [number, proposal] : registry_.of(map)) {
      const bool is_of_other = !ask.client.empty() && ask.client != proposal.client;
      if (std::pair(id, number) <= after || is_of_other) continue;
      page.proposals.push_back({proposal_id(map, number), map, entry.name, proposal});
      if (page.proposals.size() >= kMostTold) return answer(std::move(page));
    }
  }
  answer(std::move(page));
}

void ProposalAdministration::read(const Named& which, const AdminAnswer& answer,
                                  std::function<void(KeptProposal kept)> use) {
  context_.store->run([this, which, answer, use = std::move(use)](Store& store) {
    auto kept = store.read_proposal(which.map, which.number);
    context_.post([answer, use, kept = std::move(kept)]() mutable {
      if (!kept) return answer(refusal(kept.error()));
      use(std::move(*kept));
    });
  });
}

void ProposalAdministration::take(const asked::ShowProposal& ask, const AdminAnswer& answer) {
  const auto which = find(ask.proposal, answer);
  if (!which) return;
  read(*which, answer, [this, which = *which, answer](KeptProposal kept) {
    const MapEntry* entry = maps_.array().find(which.map);
    if (entry == nullptr) return answer(refusal(ErrorCode::kNotFound, "the map has gone meanwhile"));
    const ProposalSummary& summary = kept.record.summary;
    told::WholeProposal whole{{proposal_id(which.map, summary.number), which.map, entry->name, summary},
                              kept.image.size(),
                              kept.record.measurements.size(),
                              {}};
    context_.executors.idle.submit([this, answer, whole = std::move(whole), kept = std::move(kept),
                                    snapshot = entry->snapshot, epochs = entry->epochs] {
      context_.post([answer, whole,
                     points = points_in(*snapshot, epochs, kept, context_.options.mapping.refind)]() mutable {
        whole.expected_now = std::move(points);
        answer(std::move(whole));
      });
    });
  });
}

void ProposalAdministration::take(const asked::ProposalImage& ask, const AdminAnswer& answer) {
  const auto which = find(ask.proposal, answer);
  if (!which) return;
  read(*which, answer, [answer, offset = ask.offset](const KeptProposal& kept) {
    const size_t from = std::min<size_t>(offset, kept.image.size());
    const size_t size = std::min(wire::kMaxAdminData, kept.image.size() - from);
    const auto begin = kept.image.begin() + static_cast<std::ptrdiff_t>(from);
    answer(told::ImagePiece{kept.image.size(), {begin, begin + static_cast<std::ptrdiff_t>(size)}});
  });
}

void ProposalAdministration::take(const asked::DropProposal& ask, const AdminAnswer& answer) {
  if (const auto which = find(ask.proposal, answer)) drop(*which, answer);
}

void ProposalAdministration::drop(const Named& which, const AdminAnswer& answer) {
  if (maps_.array().find(which.map)->rolling_back) return answer(refusal(ErrorCode::kRefused, kRollingBack));
  MapUpdate update;
  update.removed_proposals.push_back(which.number);
  context_.store->write(which.map, std::move(update), [this, which, answer](const Status& written) {
    context_.post([this, which, answer, written] {
      if (!written) return answer(refusal(written.error()));
      registry_.remove(which.map, which.number);
      answer(told::DroppedProposal{proposal_id(which.map, which.number)});
    });
  });
}

std::string ProposalAdministration::why_not_accepted(MapId map, const MapEntry& entry) const {
  if (std::string frozen = context_.access().why_frozen(map); !frozen.empty())
    return frozen + "; `cairnctl map " + entry.name + " unfreeze` lets it grow again";
  if (!entry.failed.empty()) return "the map takes nothing: " + entry.failed;
  if (entry.leaving) return "the map is being deleted";
  if (entry.rolling_back) return kRollingBack;
  if (std::string trouble = context_.store->trouble(); !trouble.empty()) return trouble;
  return capacity_.why_map_is_full(entry);
}

void ProposalAdministration::take(const asked::AcceptProposal& ask, const AdminAnswer& answer) {
  const auto which = find(ask.proposal, answer);
  if (!which) return;
  if (std::string why = why_not_accepted(which->map, *maps_.array().find(which->map)); !why.empty())
    return answer(refusal(ErrorCode::kRefused, std::move(why)));
  read(*which, answer,
       [this, which = *which, answer](KeptProposal kept) { offer(which, std::move(kept), answer); });
}

void ProposalAdministration::offer(const Named& which, KeptProposal kept, const AdminAnswer& answer) {
  MapEntry* entry = maps_.array().find(which.map);
  const auto camera = make_camera(kept.record.camera);
  if (entry == nullptr) return answer(refusal(ErrorCode::kNotFound, "the map has gone meanwhile"));
  if (!camera) return answer(refusal(camera.error()));
  const std::string client = kept.record.summary.client;
  entry->used_at = context_.now();
  const auto done = [this, which, answer, client, runner = entry->runner](const OfferJudgement& judgement) {
    context_.post([this, which, answer, client, runner, judgement] {
      MapEntry* judged = maps_.array().find(which.map);
      const bool is_same = judged != nullptr && judged->runner == runner;
      if (is_same) maps_.array().end_offer(judged);
      on_decided(which, client, judgement, is_same && !judged->rolling_back, answer);
    });
  };
  entry->runner->offer(accepted_job(which.number, *camera, std::move(kept)), done);
  maps_.array().begin_offer(entry);
}

void ProposalAdministration::on_decided(const Named& which, const std::string& client,
                                        const OfferJudgement& judgement, bool is_final,
                                        const AdminAnswer& answer) {
  const std::string id = proposal_id(which.map, which.number);
  if (judgement.decision == wire::OfferDecision::kAccepted) {
    registry_.remove(which.map, which.number);
    maps_.young().forget(which.map);
    context_.log->info("proposal {} of {} is keyframe {} of its map", id, client, judgement.keyframe.value);
    return answer(told::AcceptedProposal{id, which.map, client, judgement.keyframe});
  }
  if (judgement.decision != wire::OfferDecision::kStale || !is_final)
    return answer(refusal(ErrorCode::kRefused, judgement.reason + "; it stays until it is dropped"));
  // What it was measured against does not come back.
  drop(which, [answer, why = judgement.reason](const OperatorAnswer& dropped) {
    answer(refusal(ErrorCode::kRefused, dropped ? why + "; it has been dropped" : why));
  });
}

}  // namespace cairn
