// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <utility>

#include "common/map/ids.h"
#include "common/wire/serialized_writer.h"

namespace cairn {

/// The blocks of one topic of one map in the form in which they travel. Every version is serialized once for
/// all clients, as long as it is the newest: a client that is still at an older one has that for itself. Used
/// from one thread.
template <typename Message>
class NewestBlocks {
 public:
  /// `writer`: of this topic, of any client; `block`: of the map.
  template <typename Writer, typename Block>
  [[nodiscard]] auto get(const Writer& writer, MapId map, Epoch epoch, const Block& block)
      -> decltype(writer.serialize(Message{})) {
    if (epoch_ < epoch) {
      kept_.clear();
      epoch_ = epoch;
    }
    const auto kept = kept_.find(block.index);
    const bool is_known = epoch == epoch_ && kept != kept_.end();
    if (is_known && kept->second.first == block.version) return kept->second.second;
    auto made = writer.serialize(Message{map, epoch, block});
    const bool is_newest = epoch == epoch_ && (!is_known || kept->second.first < block.version);
    if (made && is_newest) kept_.insert_or_assign(block.index, std::pair(block.version, *made));
    return made;
  }

 private:
  Epoch epoch_;
  std::map<uint32_t, std::pair<uint64_t, wire::Serialized<Message>>> kept_;  ///< version, by index
};

/// The serialized blocks of one map, for all who are sent it.
struct SerializedBlocks {
  NewestBlocks<wire::PointPatches> patches;
  NewestBlocks<wire::PointPositions> positions;
  NewestBlocks<wire::KeyframePoses> keyframes;
};

}  // namespace cairn
