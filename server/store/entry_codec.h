// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "server/store/map_file.h"
#include "server/store/overlap_record.h"
#include "server/store/row_codec.h"

/// The blobs of rows that are about a map rather than of it: who it is, its epochs, what was decided, its
/// labels, what it has in common with others. As row_codec.h. Pure.
namespace cairn {

/// How many keyframes and points were ever made stands beside who the map is.
struct CountedHeader {
  MapHeader header;
  size_t keyframes = 0;
  size_t points = 0;
};
[[nodiscard]] Blob encode_header(const CountedHeader& header);
[[nodiscard]] std::optional<CountedHeader> decode_header(std::span<const uint8_t> row);

[[nodiscard]] Blob encode_epoch(const EpochRecord& epoch);
[[nodiscard]] std::optional<EpochRecord> decode_epoch(int64_t id, std::span<const uint8_t> row);

[[nodiscard]] Blob encode_decision(const DecisionRecord& decision);
[[nodiscard]] std::optional<DecisionRecord> decode_decision(std::span<const uint8_t> row);

[[nodiscard]] Blob encode_label(const LabelRecord& label);
[[nodiscard]] std::optional<LabelRecord> decode_label(int64_t id, std::span<const uint8_t> row);

/// The name of a client.
[[nodiscard]] Blob encode_contributor(const std::string& client);
[[nodiscard]] std::optional<std::string> decode_contributor(std::span<const uint8_t> row);

[[nodiscard]] Blob encode_tag(const MapTag& tag);
[[nodiscard]] std::optional<MapTag> decode_tag(int64_t id, std::span<const uint8_t> row);

[[nodiscard]] Blob encode_overlap(const OverlapRecord& overlap);
[[nodiscard]] std::optional<OverlapRecord> decode_overlap(std::span<const uint8_t> row);

}  // namespace cairn
