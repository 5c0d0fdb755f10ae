// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/map_feed.h"

#include <utility>

#include "common/wire/partition.h"

namespace cairn {

Result<MapFeed> MapFeed::create(const wire::Participant& participant, const std::string& client, MapId map,
                                Logger log) {
  auto writers =
      wire::create_all<wire::Writer<wire::PointPatches>, wire::Writer<wire::PointPositions>,
                       wire::Writer<wire::KeyframePoses>, wire::Writer<wire::MapCommit>,
                       wire::Writer<wire::LabelMessage>>(participant, wire::map_partition(client, map));
  if (!writers) return tl::unexpected(writers.error());
  auto& [patches, positions, keyframes, commits, labels] = *writers;
  return MapFeed(
      {std::move(patches), std::move(positions), std::move(keyframes), std::move(commits), std::move(labels)},
      std::move(log));
}

Status MapFeed::hide(MapId map, LabelId label) {
  wire::LabelMessage key;
  key.map = map;
  key.label.id = label;
  return writers_.labels.dispose(key);
}

std::optional<MonotonicTime> MapFeed::deadline() const {
  return progress_ ? MonotonicTime::min() : publisher_.deadline();
}

void MapFeed::work(MonotonicTime now) {
  if (!progress_) {
    std::optional<Burst> burst = publisher_.next(now);
    if (!burst) return;
    progress_ = Progress{std::move(*burst), 0};
  }
  const Burst& burst = progress_->burst;
  const size_t blocks = burst.keyframes.size() + burst.patches.size() + burst.positions.size();
  Status written;
  for (size_t i = 0; written && i < kBlocksPerTurn && progress_->written < blocks; ++i) {
    written = write_block(burst, progress_->written++);
  }
  if (written && progress_->written == blocks) {
    written = writers_.commits.write(burst.commit);
    progress_.reset();
  }
  if (!written) {
    log_->error("a revision of a map could not be written, it will be tried again: {}",
                written.error().message);
    progress_.reset();
    publisher_.failed(now);
  }
}

Status MapFeed::write_block(const Burst& burst, size_t index) {
  if (index < burst.keyframes.size()) {
    return writers_.keyframes.write({burst.map, burst.epoch, *burst.keyframes[index]});
  }
  index -= burst.keyframes.size();
  if (index < burst.patches.size())
    return writers_.patches.write({burst.map, burst.epoch, *burst.patches[index]});
  index -= burst.patches.size();
  return writers_.positions.write({burst.map, burst.epoch, *burst.positions[index]});
}

}  // namespace cairn
