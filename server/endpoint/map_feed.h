// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "common/base/log.h"
#include "common/wire/participant.h"
#include "common/wire/topic.h"
#include "server/service/map_publisher.h"

namespace cairn {

/// One map on its way to one client: the writers in the client's partition for that map, behind a
/// MapPublisher. A large burst is written in slices, so that one client's first map does not hold up the
/// others. Used from one thread.
class MapFeed {
 public:
  [[nodiscard]] static Result<MapFeed> create(const wire::Participant& participant, const std::string& client,
                                              MapId map, Logger log);

  void update(MapSnapshotPtr newest) { publisher_.update(std::move(newest)); }
  void client_has(Epoch epoch, Revision revision) { publisher_.client_has(epoch, revision); }

  /// Labels are not part of a revision: they are written at once.
  [[nodiscard]] Status show(const wire::LabelMessage& label) { return writers_.labels.write(label); }
  [[nodiscard]] Status hide(MapId map, LabelId label);

  /// Writes what is due, at most kBlocksPerTurn blocks of it.
  void work(MonotonicTime now);
  /// When work() should be called next; nothing when there is nothing to send.
  [[nodiscard]] std::optional<MonotonicTime> deadline() const;

 private:
  static constexpr size_t kBlocksPerTurn = 8;  // some 360 kB: 150 ms on a link of 20 Mbit/s

  struct Writers {
    wire::Writer<wire::PointPatches> patches;
    wire::Writer<wire::PointPositions> positions;
    wire::Writer<wire::KeyframePoses> keyframes;
    wire::Writer<wire::MapCommit> commits;
    wire::Writer<wire::LabelMessage> labels;
  };
  struct Progress {
    Burst burst;
    size_t written = 0;  ///< blocks, counted through keyframes, patches, positions
  };
  MapFeed(Writers writers, Logger log) : writers_(std::move(writers)), log_(std::move(log)) {}
  [[nodiscard]] Status write_block(const Burst& burst, size_t index);

  Writers writers_;
  Logger log_;
  MapPublisher publisher_;
  std::optional<Progress> progress_;
};

}  // namespace cairn
