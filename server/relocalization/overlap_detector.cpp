// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/overlap_detector.h"

#include <algorithm>
#include <utility>

namespace cairn {
namespace {

/// Poses of a shared view in the present frames of both maps; nothing if one of its keyframes has gone.
std::optional<SharedView> view_of(const MapSnapshot& map, KeyframeId keyframe, const MapSnapshot& other_map,
                                  KeyframeId other, const SE3& camera_from_other) {
  const KeyframePose* here = map.find(keyframe);
  const KeyframePose* there = other_map.find(other);
  if (here == nullptr || there == nullptr) return std::nullopt;
  return SharedView{here->camera_from_map, camera_from_other * there->camera_from_map, here->mean_depth,
                    there->mean_depth};
}

}  // namespace

std::vector<PlaceCandidate> find_in_each_map(PlaceIndex index, const Camera& camera, const PlaceView& view,
                                             const RelocOptions& options) {
  std::vector<PlaceCandidate> found;
  while (found.size() < options.overlap.most_maps && index.keyframe_count() > 0) {
    const RelocalizationAnswer answer = relocalize(index, camera, view, options);
    if (answer.verdict != RelocalizationVerdict::kConfirmed) break;
    for (const PlaceCandidate& candidate : answer.candidates) {
      const bool is_known = std::ranges::any_of(found, [&](const auto& f) { return f.map == candidate.map; });
      if (!candidate.confirmed || is_known) continue;
      found.push_back(candidate);
      index.remove(candidate.map);
    }
  }
  return found;
}

void OverlapDetector::note_searched(const IndexedMap& map) {
  ++clock_;
  const Entries before = std::exchange(keyframes_[map.snapshot->map], {});
  Entries& now = keyframes_[map.snapshot->map];
  for (const IndexedKeyframePtr& keyframe : map.keyframes) {
    const auto known = before.find(keyframe->id);
    now.emplace_hint(now.end(), keyframe->id,
                     known != before.end() ? known->second : Entry{clock_, 0, false});
  }
}

void OverlapDetector::remove(const MapId& map) {
  keyframes_.erase(map);
  std::erase_if(shown_,
                [&](const auto& entry) { return entry.first.one == map || entry.first.other == map; });
}

std::vector<Overlap> OverlapDetector::note_answer(const MapId& map, KeyframeId keyframe, uint64_t time,
                                                  std::span<const PlaceCandidate> found,
                                                  const PlaceIndex& index) {
  const auto entries = keyframes_.find(map);
  if (entries == keyframes_.end()) return {};
  const auto entry = entries->second.find(keyframe);
  if (entry == entries->second.end()) return {};  // it has been culled meanwhile
  entry->second.asked_at = time;
  entry->second.is_found = !found.empty();
  std::vector<Overlap> overlaps;
  for (const PlaceCandidate& candidate : found) {
    if (candidate.map == map || !keyframes_.contains(candidate.map)) continue;
    const MapPair pair = pair_of(map, candidate.map);
    std::vector<Shown>& shown = shown_[pair];
    if (shown.size() == options_.most_shown) shown.erase(shown.begin());
    shown.push_back({pair.one == map, keyframe, candidate.keyframe, candidate.camera_from_keyframe, time});
    if (const auto overlap = judge(pair, index)) overlaps.push_back(*overlap);
  }
  return overlaps;
}

std::optional<Overlap> OverlapDetector::judge(const MapPair& pair, const PlaceIndex& index) const {
  const IndexedMap* one = index.find(pair.one);
  const IndexedMap* other = index.find(pair.other);
  if (one == nullptr || other == nullptr) return std::nullopt;
  std::vector<SharedView> views;
  std::vector<bool> is_of_one;
  const std::vector<Shown>& shown = shown_.at(pair);
  // As far back as those that are counted for it go those that are counted against it.
  const uint64_t since = shown.size() == options_.most_shown ? shown.front().asked_at : 0;
  for (const Shown& s : shown) {
    auto view = s.is_of_one
                    ? view_of(*one->snapshot, s.keyframe, *other->snapshot, s.other, s.camera_from_other)
                    : view_of(*other->snapshot, s.keyframe, *one->snapshot, s.other, s.camera_from_other);
    if (!view) continue;
    if (!s.is_of_one) {
      std::swap(view->camera_from_one, view->camera_from_other);
      std::swap(view->depth_in_one, view->depth_in_other);
    }
    views.push_back(*view);
    is_of_one.push_back(s.is_of_one);
  }
  const auto agreement = find_agreement(views, options_.agreement);
  if (!agreement || agreement->views.size() < options_.least_keyframes) return std::nullopt;
  const Similarity3& other_from_one = agreement->other_from_one;
  const size_t missing = count_missing(*one, *other, other_from_one, since) +
                         count_missing(*other, *one, other_from_one.inverse(), since);
  if (agreement->views.size() < missing) return std::nullopt;
  Overlap overlap{pair, 0, 0};
  for (const size_t view : agreement->views) ++(is_of_one[view] ? overlap.of_one : overlap.of_other);
  return overlap;
}

size_t OverlapDetector::count_missing(const IndexedMap& asked, const IndexedMap& other,
                                      const Similarity3& other_from_asked, uint64_t since) const {
  struct Standing {
    const KeyframePose* pose;
    Eigen::Vector3d center;
    uint64_t searched_since;
  };
  std::vector<Standing> standing;
  for (const auto& [keyframe, entry] : keyframes_.at(other.snapshot->map)) {
    if (const KeyframePose* pose = other.snapshot->find(keyframe))
      standing.push_back({pose, pose->camera_from_map.center(), entry.searched_since});
  }
  size_t missing = 0;
  for (const auto& [keyframe, kept] : keyframes_.at(asked.snapshot->map)) {
    const auto& entry = kept;
    const KeyframePose* here = asked.snapshot->find(keyframe);
    if (entry.asked_at == 0 || entry.asked_at < since || entry.is_found || here == nullptr) continue;
    const SE3 camera = other_from_asked.transform_camera(here->camera_from_map);
    const Eigen::Vector3d center = camera.center();
    const double depth = other_from_asked.scale() * here->mean_depth;
    missing += static_cast<size_t>(std::ranges::any_of(standing, [&](const Standing& there) {
      const double least = std::min(depth, static_cast<double>(there.pose->mean_depth));
      return there.searched_since < entry.asked_at &&
             (center - there.center).norm() <= options_.next_to * least &&
             separation(camera, there.pose->camera_from_map, least) <= options_.next_to;
    }));
  }
  return missing;
}

}  // namespace cairn
