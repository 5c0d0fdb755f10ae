// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/map_feed.h"

#include <algorithm>
#include <utility>

#include "common/wire/partition.h"

namespace cairn {
namespace {

template <typename Message, typename Block>
Result<size_t> write_once(wire::SerializedWriter<Message>& writer, NewestBlocks<Message>& known,
                          const Burst& burst, const Block& block) {
  const auto message = known.get(writer, burst.map, burst.epoch, block);
  if (!message) return tl::unexpected(message.error());
  if (Status written = writer.write(*message); !written) return tl::unexpected(written.error());
  return message->bytes;
}

}  // namespace

Result<MapFeed> MapFeed::create(const wire::Participant& participant, const std::string& client, MapId map,
                                std::shared_ptr<SerializedBlocks> blocks, Logger log) {
  auto writers =
      wire::create_all<wire::SerializedWriter<wire::PointPatches>,
                       wire::SerializedWriter<wire::PointPositions>,
                       wire::SerializedWriter<wire::KeyframePoses>, wire::Writer<wire::MapCommit>,
                       wire::Writer<wire::LabelMessage>>(participant, wire::map_partition(client, map));
  if (!writers) return tl::unexpected(writers.error());
  auto& [patches, positions, keyframes, commits, labels] = *writers;
  return MapFeed(
      {std::move(patches), std::move(positions), std::move(keyframes), std::move(commits), std::move(labels)},
      std::move(blocks), std::move(log));
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

size_t MapFeed::work(MonotonicTime now, size_t bytes) {
  if (!progress_) {
    std::optional<Burst> burst = publisher_.next(now);
    if (!burst) return 1;
    progress_ = Progress{std::move(*burst), 0};
  }
  const Burst& burst = progress_->burst;
  const size_t blocks = burst.keyframes.size() + burst.patches.size() + burst.positions.size();
  Status written;
  size_t sum = 0;
  while (written && sum < bytes && progress_->written < blocks) {
    const Result<size_t> block = write_block(burst, progress_->written);
    if (block) {
      sum += *block;
      ++progress_->written;
    } else {
      written = tl::unexpected(block.error());
    }
  }
  writers_.keyframes.flush();
  writers_.patches.flush();
  writers_.positions.flush();
  if (written && progress_->written == blocks) {
    sum += burst.commit.points.size() * sizeof(wire::BlockVersion);
    written = writers_.commits.write(burst.commit);
    progress_.reset();
  }
  if (!written) {
    log_->error("a revision of a map could not be written, it will be tried again: {}",
                written.error().message);
    progress_.reset();
    publisher_.failed(now);
  }
  return std::max<size_t>(sum, 1);
}

Result<size_t> MapFeed::write_block(const Burst& burst, size_t index) {
  if (index < burst.keyframes.size()) {
    return write_once(writers_.keyframes, blocks_->keyframes, burst, *burst.keyframes[index]);
  }
  index -= burst.keyframes.size();
  if (index < burst.patches.size())
    return write_once(writers_.patches, blocks_->patches, burst, *burst.patches[index]);
  index -= burst.patches.size();
  return write_once(writers_.positions, blocks_->positions, burst, *burst.positions[index]);
}

}  // namespace cairn
