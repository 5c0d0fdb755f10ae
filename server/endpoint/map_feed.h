// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "common/base/log.h"
#include "common/wire/participant.h"
#include "common/wire/serialized_writer.h"
#include "common/wire/topic.h"
#include "server/endpoint/serialized_blocks.h"
#include "server/service/map_publisher.h"

namespace cairn {

/// One map on its way to one client: the writers in the client's partition for that map, behind a
/// MapPublisher. A large burst is written in slices (FeedTurns), so that one client's map holds up nobody.
/// Used from one thread.
class MapFeed {
 public:
  [[nodiscard]] static Result<MapFeed> create(const wire::Participant& participant, const std::string& client,
                                              MapId map, std::shared_ptr<SerializedBlocks> blocks,
                                              Logger log);

  void update(MapSnapshotPtr newest) { publisher_.update(std::move(newest)); }
  void client_has(Epoch epoch, Revision revision) { publisher_.client_has(epoch, revision); }

  /// Labels are not part of a revision: they are written at once.
  [[nodiscard]] Status show(const wire::LabelMessage& label) { return writers_.labels.write(label); }
  [[nodiscard]] Status hide(MapId map, LabelId label);

  /// Writes what is due, blocks of it until so many bytes are reached. Returns how many bytes were written, 1
  /// at least.
  size_t work(MonotonicTime now, size_t bytes);
  /// When work() should be called next; nothing when there is nothing to send.
  [[nodiscard]] std::optional<MonotonicTime> deadline() const;

 private:
  struct Writers {
    wire::SerializedWriter<wire::PointPatches> patches;
    wire::SerializedWriter<wire::PointPositions> positions;
    wire::SerializedWriter<wire::KeyframePoses> keyframes;
    wire::Writer<wire::MapCommit> commits;
    wire::Writer<wire::LabelMessage> labels;
  };
  struct Progress {
    Burst burst;
    size_t written = 0;  ///< blocks, counted through keyframes, patches, positions
  };
  MapFeed(Writers writers, std::shared_ptr<SerializedBlocks> blocks, Logger log)
      : writers_(std::move(writers)), blocks_(std::move(blocks)), log_(std::move(log)) {}
  /// Writes a block. Returns how many bytes it has.
  [[nodiscard]] Result<size_t> write_block(const Burst& burst, size_t index);

  Writers writers_;
  std::shared_ptr<SerializedBlocks> blocks_;
  Logger log_;
  MapPublisher publisher_;
  std::optional<Progress> progress_;
};

}  // namespace cairn
