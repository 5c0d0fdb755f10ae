// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <span>

#include "common/base/log.h"
#include "server/relocalization/overlap_detector.h"
#include "server/service/executor.h"
#include "server/service/work_times.h"

namespace cairn {

/// Notices that a map grows over another: asks about each new keyframe whether another map knows its place.
/// In an executor that stands back for all others; of a map eight keyframes wait at most, the newest, so that
/// it may pass over some. Thread-safe; tasks keep it alive.
class OverlapWatch : public std::enable_shared_from_this<OverlapWatch> {
 public:
  using IndexSource = std::function<std::shared_ptr<const PlaceIndex>()>;
  /// Called in the executor, each time that a keyframe tells of an overlap.
  using Listener = std::function<void(const Overlap& overlap)>;

  /// `index`: what is searched now. `times`: null, or outlives the executor.
  OverlapWatch(Executor& executor, const RelocOptions& options, IndexSource index, Listener listener,
               Logger log, WorkTimes* times = nullptr);

  /// A map is searched as it is here. The keyframes that are new since the last time, and come with an image
  /// and its corners, are asked about. Does not wait, nor does remove().
  void note_searched(const IndexedMapPtr& map, std::span<const KeyframeView> views);
  void remove(const MapId& map);

 private:
  /// The keyframe of the map that has waited longest, if one does, with the detector brought up to date.
  [[nodiscard]] std::optional<KeyframeView> take_waiting(const MapId& map);
  void check(const MapId& map);
  /// Looks for a keyframe in the other maps. False: there is none.
  bool look_up(const MapId& map, const KeyframeView& keyframe);

  Executor& executor_;
  const RelocOptions options_;
  const IndexSource index_;
  const Listener listener_;
  Logger log_;
  WorkTimes* times_;

  std::mutex checking_;       ///< one at a time; before mutex_
  OverlapDetector detector_;  ///< under checking_

  std::mutex mutex_;                                   ///< of what follows; held for moments
  std::set<MapId> removed_;                            ///< since the last check, before what is searched_
  std::map<MapId, IndexedMapPtr> searched_;            ///< the newest since the last check
  std::map<MapId, KeyframeId> newest_;                 ///< keyframes up to this have had their turn
  std::map<MapId, std::deque<KeyframeView>> waiting_;  ///< to be asked about; as many tasks as keyframes
};

}  // namespace cairn
