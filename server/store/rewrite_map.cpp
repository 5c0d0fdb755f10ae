// SPDX-License-Identifier: Apache-2.0
#include "server/store/rewrite_map.h"

#include <algorithm>
#include <utility>

#include "server/store/epochs.h"

namespace cairn {
namespace {

/// A label whose keyframe goes stays in its place in the map.
void move_labels(const MapState& before, const Renumbering& now, std::vector<LabelRecord>* labels) {
  for (LabelRecord& label : *labels) {
    if (!before.is_live(label.anchor)) {
      label.anchor = {};
      continue;
    }
    label.map_from_label = before.keyframe(label.anchor).camera_from_map.inverse() * label.anchor_from_label;
    label.anchor = now.of(label.anchor);
  }
}

/// Gives a proposal another reference keyframe, the nearest that stays; its pose in the map stays the same.
void take_beside(const MapState& state, const SE3& camera_from_map, ProposalRecord* proposal) {
  const Eigen::Vector3d center = camera_from_map.center();
  const auto distance = [&](const MapKeyframe& k) { return (k.camera_from_map.center() - center).norm(); };
  const auto nearest = std::ranges::min_element(state.keyframes(), {}, distance);
  proposal->reference = nearest->id;
  proposal->camera_from_reference = camera_from_map * nearest->camera_from_map.inverse();
}

/// Gives a proposal the ids that its map has now. A proposal that could not be accepted any more stays as it
/// is: when it is to be accepted, that is told.
void renumber(const StoredMap& stored, const MapState& before, const MapState& state, const Renumbering& now,
              ProposalRecord* proposal) {
  if (stored.epochs.empty()) return;
  const auto same = ids_in_common(stored.epochs, proposal->summary.epoch, stored.epochs.back().epoch);
  if (!same || proposal->reference.value > same->keyframes || !before.is_live(proposal->reference)) return;
  const SE3 camera_from_map =
      proposal->camera_from_reference * before.keyframe(proposal->reference).camera_from_map;
  proposal->reference = now.of(proposal->reference);
  if (!proposal->reference) take_beside(state, camera_from_map, proposal);
  std::erase_if(proposal->measurements, [&](PointMeasurement& m) {
    m.id = m.id.value > same->points ? PointId{} : now.of(m.id);
    return !m.id;
  });
  proposal->summary.epoch = stored.header.epoch;
}

/// Reads the proposals that stay, and adapts them by `make_fit`. One that is damaged is left out and named in
/// `stored`. Any other error is returned, since that proposal is not lost.
Result<std::vector<KeptProposal>> proposals_that_stay(MapFile* file, StoredMap* stored,
                                                      const std::string& dropped_client,
                                                      const std::function<void(ProposalRecord*)>& make_fit) {
  std::vector<KeptProposal> others;
  for (const ProposalSummary& known : stored->proposals) {
    if (!dropped_client.empty() && known.client == dropped_client) continue;
    auto proposal = file->read_proposal(known.number);
    if (!proposal && proposal.error().code != ErrorCode::kDamaged) return tl::unexpected(proposal.error());
    if (!proposal) {
      stored->lost_proposals.push_back(proposal.error().message);
      continue;
    }
    make_fit(&proposal->record);
    others.push_back(std::move(*proposal));
  }
  return others;
}

/// The work that was due of what is still there, under new ids.
WorkRecord work_left(const StoredMap& stored, const MapState& state, const Renumbering& now,
                     bool is_changed) {
  WorkRecord work = stored.record.work.value_or(WorkRecord());
  for (PendingKeyframe& p : work.wanting_points) p.id = now.of(p.id);
  std::erase_if(work.wanting_points, [](const PendingKeyframe& p) { return !p.id; });
  for (PointId& id : work.wanting_observers) id = now.of(id);
  std::erase(work.wanting_observers, PointId{});
  work.newest = now.of(work.newest);
  if (!work.newest) work.newest = state.keyframes().back().id;
  if (is_changed) work.upkeep_due = work.global_adjustment_due = true;
  return work;
}

Status prepare(Store* store, MapId map, const MapRewrite& how, const AcceptState& accept) {
  auto file = MapFile::open(store->path_of(map));
  if (!file) return tl::unexpected(file.error());
  StoredMap stored = file->load(LoadedImages::kDecodedOnly);
  if (!stored.damage.empty()) return fail(ErrorCode::kDamaged, stored.damage.front());
  auto assembled = assemble_map(stored.record, RestoredImages::kEvicted);
  if (!assembled) return tl::unexpected(assembled.error());
  MapState& state = assembled->state;
  const MapState before = state;
  if (Status taken = how.take_out(stored, &state); !taken) return taken;
  const Renumbering now = state.compact();
  const KeyframeIds renumbered = [&now](KeyframeId id) { return now.of(id); };

  MapUpdate whole{
      MapRecorder().take(state, *stored.record.foundation, work_left(stored, state, now, how.is_changed)),
      std::move(stored.decisions),
      std::move(stored.labels),
      {}};
  how.follow(now, &whole.decisions);
  move_labels(before, now, &whole.labels);
  for (auto& [keyframe, contributor] : stored.contributions) {
    if (const KeyframeId id = now.of(keyframe)) whole.contributions.emplace_back(id, std::move(contributor));
  }
  ++stored.header.epoch.value;  // none of before is among those that the file knows
  auto proposals = proposals_that_stay(&*file, &stored, how.dropped_client, [&](ProposalRecord* proposal) {
    renumber(stored, before, state, now, proposal);
  });
  if (!proposals) return tl::unexpected(proposals.error());
  whole.proposals = std::move(*proposals);
  whole.last_proposal = stored.last_proposal;
  Status done = store->prepare_rewrite(stored.header, whole, &*file, renumbered, accept);
  if (done) store->note_lost_proposals(map, stored);
  return done;
}

}  // namespace

Status rewrite_map(Store* store, MapId map, const MapRewrite& how, const AcceptState& accept) {
  const Status prepared = prepare(store, map, how, accept);
  return prepared ? store->finish_rewrite(map) : prepared;
}

}  // namespace cairn
