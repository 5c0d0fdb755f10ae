// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "common/base/time.h"
#include "common/map/snapshot.h"
#include "common/wire/messages.h"

namespace cairn {

/// One revision on its way to one client: what the client does not have in this version, to be written in
/// this order, then the commit.
struct Burst {
  MapId map;
  Epoch epoch;
  std::vector<std::shared_ptr<const KeyframeBlock>> keyframes;
  std::vector<std::shared_ptr<const PatchBlock>> patches;
  std::vector<std::shared_ptr<const PositionBlock>> positions;
  wire::MapCommit commit;
};

/// Decides when which blocks of a map go to one client (DESIGN 4). Adjustments are coalesced to at most five
/// bursts a second, a new keyframe or new points go at once; in either case the next burst starts only when
/// the client has swapped the last one in, or 500 ms after it. Pure: the time is handed in. One per client
/// and map; used from one thread.
class MapPublisher {
 public:
  static constexpr std::chrono::milliseconds kAdjustmentInterval{200};
  static constexpr std::chrono::milliseconds kCatchUpLimit{500};
  static constexpr std::chrono::seconds kRetryInterval{2};

  /// The newest snapshot of the map; revisions in between are skipped.
  void update(MapSnapshotPtr newest) { newest_ = std::move(newest); }
  /// The client's word on what it has swapped in.
  void client_has(Epoch epoch, Revision revision);

  /// The burst that is due now, counted as written; nothing if there is none.
  [[nodiscard]] std::optional<Burst> next(MonotonicTime now);
  /// The last burst could not be written to its end: everything is due again, after kRetryInterval.
  void failed(MonotonicTime now);
  /// When next() would have something if nothing else happens; nothing when the client is up to date.
  [[nodiscard]] std::optional<MonotonicTime> deadline() const;

 private:
  struct BlockVersions {
    uint64_t patches = 0;
    uint64_t positions = 0;
  };
  [[nodiscard]] bool is_up_to_date() const;
  [[nodiscard]] bool has_caught_up() const;
  [[nodiscard]] Burst make_burst();

  MapSnapshotPtr newest_;
  MapSnapshotPtr sent_;  ///< of the last burst; null before the first
  MonotonicTime sent_at_;
  MonotonicTime retry_at_ = MonotonicTime::min();  ///< after a failure
  Epoch client_epoch_;
  Revision client_revision_;
  std::map<uint32_t, BlockVersions> sent_points_;
  std::map<uint32_t, uint64_t> sent_keyframes_;
};

}  // namespace cairn
