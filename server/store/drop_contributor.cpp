// SPDX-License-Identifier: Apache-2.0
#include "server/store/drop_contributor.h"

#include <algorithm>
#include <functional>
#include <set>
#include <utility>

#include "server/mapping/map_record.h"
#include "server/store/epochs.h"

namespace cairn {
namespace {

constexpr size_t kFewestKeyframes = 2;

std::set<KeyframeId> keyframes_of(const StoredMap& map, const std::string& client) {
  std::set<KeyframeId> keyframes;
  for (const auto& [keyframe, contributor] : map.contributions) {
    if (contributor == client) keyframes.insert(keyframe);
  }
  return keyframes;
}

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

/// What is known of ids has no meaning any more; that a command was decided stays.
void forget_ids(const std::string& client, std::vector<DecisionRecord>* decisions) {
  std::erase_if(*decisions, [&](const DecisionRecord& d) { return d.client == client; });
  for (DecisionRecord& d : *decisions) {
    d.keyframe = {};
    d.seed_points.clear();
  }
}

/// Where the frame was taken is said of another keyframe: one that stays.
void take_beside(const MapState& state, const SE3& camera_from_map, ProposalRecord* proposal) {
  const Eigen::Vector3d center = camera_from_map.center();
  const auto distance = [&](const MapKeyframe& k) { return (k.camera_from_map.center() - center).norm(); };
  const auto nearest = std::ranges::min_element(state.keyframes(), {}, distance);
  proposal->reference = nearest->id;
  proposal->camera_from_reference = camera_from_map * nearest->camera_from_map.inverse();
}

/// As the map is called now. One that could not be accepted any more stays as it is: that is told, then.
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

/// One that is damaged is lost, and named in `stored`; one that cannot be read for now is not: any other
/// error.
Result<std::vector<KeptProposal>> proposals_of_others(MapFile* file, StoredMap* stored,
                                                      const std::string& client,
                                                      const std::function<void(ProposalRecord*)>& make_fit) {
  std::vector<KeptProposal> others;
  for (const ProposalSummary& known : stored->proposals) {
    if (known.client == client) continue;
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

Status rewrite_without(Store* store, MapId map, const std::string& client, const AcceptState& accept) {
  auto file = MapFile::open(store->path_of(map));
  if (!file) return tl::unexpected(file.error());
  StoredMap stored = file->load(LoadedImages::kDecodedOnly);
  if (!stored.damage.empty()) return fail(ErrorCode::kDamaged, stored.damage.front());
  const std::set<KeyframeId> dropped = keyframes_of(stored, client);
  auto assembled = assemble_map(stored.record, RestoredImages::kLetGo);
  if (!assembled) return tl::unexpected(assembled.error());
  MapState& state = assembled->state;
  const MapState before = state;
  size_t gone = 0;
  for (const KeyframeId id : dropped) {
    if (!state.is_live(id)) continue;
    state.remove_keyframe(id);
    ++gone;
  }
  if (gone == 0) return tl::unexpected(no_contribution(client, stored.header.name));
  if (state.live_keyframes() < kFewestKeyframes) {
    return fail(ErrorCode::kRefused, "nothing would be left of map " + stored.header.name +
                                         "; `cairnctl map " + stored.header.name +
                                         " delete` and `cairnctl maps purge`");
  }
  const Renumbering now = state.compact();
  const KeyframeIds renumbered = [&now](KeyframeId id) { return now.of(id); };

  WorkRecord work;
  work.newest = state.keyframes().back().id;
  work.upkeep_due = work.global_adjustment_due = true;
  MapUpdate whole{MapRecorder().take(state, *stored.record.foundation, work),
                  std::move(stored.decisions),
                  std::move(stored.labels),
                  {}};
  forget_ids(client, &whole.decisions);
  move_labels(before, now, &whole.labels);
  for (auto& [keyframe, contributor] : stored.contributions) {
    if (const KeyframeId id = now.of(keyframe)) whole.contributions.emplace_back(id, std::move(contributor));
  }
  ++stored.header.epoch.value;  // none of before is among those that the file knows
  auto others = proposals_of_others(&*file, &stored, client, [&](ProposalRecord* proposal) {
    renumber(stored, before, state, now, proposal);
  });
  if (!others) return tl::unexpected(others.error());
  whole.proposals = std::move(*others);
  whole.last_proposal = stored.last_proposal;
  Status done = store->prepare_rewrite(stored.header, whole, &*file, renumbered, accept);
  if (done) store->note_lost_proposals(map, stored);
  return done;
}

}  // namespace

Error no_contribution(const std::string& client, const std::string& map_name) {
  return {ErrorCode::kNotFound, "client '" + client + "' has no keyframe in map " + map_name +
                                    "; `cairnctl map " + map_name + " contributors` lists who has"};
}

Status drop_contributor(Store* store, MapId map, const std::string& client, const AcceptState& accept) {
  const Status prepared = rewrite_without(store, map, client, accept);
  return prepared ? store->finish_rewrite(map) : prepared;
}

}  // namespace cairn
