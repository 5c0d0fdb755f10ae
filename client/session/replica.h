// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "common/base/time.h"
#include "common/map/snapshot.h"
#include "common/wire/messages.h"

namespace cairn {

/// How long a replica waits for exactly the listed versions before it takes newer ones too.
constexpr std::chrono::milliseconds kOvertakenLimit{500};

/// A client's copy of one map. Blocks are staged as they come, in any order and with gaps (the middleware
/// keeps the newest value of each only), and become a MapSnapshot all at once, when a commit finds every
/// version that it lists. Epochs never mix; within an epoch revisions never go back. The snapshot is a
/// function of the staged blocks alone, not of the revisions passed through on the way. Pure: the time is
/// handed in. Used from one thread; snapshots may go anywhere.
class Replica {
 public:
  explicit Replica(MapId map) : map_(map) {}

  /// Messages of other maps and of older epochs are passed over; a newer epoch empties the staging.
  void receive(wire::PointPatches message);
  void receive(wire::PointPositions message);
  void receive(wire::KeyframePoses message);
  void receive(wire::MapCommit message);

  /// Swaps if the newest commit is complete: every listed version there exactly or, when blocks have
  /// overtaken commits for kOvertakenLimit without a swap, every block at least that new. True when
  /// snapshot() changed.
  bool update(MonotonicTime now);

  /// When update() should be called even if nothing comes; nothing when there is no need.
  [[nodiscard]] std::optional<MonotonicTime> deadline() const { return deadline_; }

  /// The newest whole revision; null before the first.
  [[nodiscard]] const MapSnapshotPtr& snapshot() const { return snapshot_; }
  [[nodiscard]] MapId map() const { return map_; }

 private:
  /// How the staged blocks stand to the pending commit.
  struct Standing {
    bool whole = true;       ///< every block is there, at least as new as listed, its halves of one length
    bool overtaken = false;  ///< some block is newer than listed
  };
  struct PointParts {
    std::shared_ptr<const PatchBlock> patches;
    std::shared_ptr<const PositionBlock> positions;
    bool operator==(const PointParts&) const = default;
  };

  bool enter_epoch(MapId map, Epoch epoch);
  [[nodiscard]] Standing standing() const;
  void swap();
  [[nodiscard]] std::set<KeyframeId> moved_keyframes(
      const std::vector<std::shared_ptr<const KeyframeBlock>>& keyframes) const;

  MapId map_;
  Epoch epoch_;
  std::map<uint32_t, PointParts> staged_points_;
  std::map<uint32_t, std::shared_ptr<const KeyframeBlock>> staged_keyframes_;
  std::optional<wire::MapCommit> pending_;  ///< newest commit, not swapped in yet
  std::optional<MonotonicTime>
      overtaken_since_;  ///< cleared by a swap only: commits may be overtaken in turn
  std::optional<MonotonicTime> deadline_;
  MapSnapshotPtr snapshot_;
  std::vector<PointParts> snapshot_parts_;  ///< what the snapshot's point blocks were made of
};

}  // namespace cairn
