// SPDX-License-Identifier: Apache-2.0
#include "server/store/entry_codec.h"

#include "common/base/enumerators.h"
#include "common/base/utf8.h"
#include "common/map/limits.h"
#include "server/store/bytes.h"

namespace cairn {
Blob encode_header(const CountedHeader& header) {
  ByteWriter out;
  out.put(std::span(header.header.id.bytes));
  out.put_text(header.header.name);
  out.put(header.header.epoch.value);
  out.put(static_cast<uint8_t>(header.header.metric));
  out.put(header.header.created.nanoseconds);
  out.put(static_cast<uint64_t>(header.keyframes));
  out.put(static_cast<uint64_t>(header.points));
  return out.take();
}

std::optional<CountedHeader> decode_header(std::span<const uint8_t> row) {
  ByteReader in(row);
  CountedHeader header;
  in.get(std::span(header.header.id.bytes));
  header.header.name = cut_text(one_line(in.get_text()), kMaxNameBytes);
  header.header.epoch.value = in.get<uint64_t>();
  header.header.metric = in.get<uint8_t>() != 0;
  header.header.created.nanoseconds = in.get<int64_t>();
  header.keyframes = in.get<uint64_t>();
  header.points = in.get<uint64_t>();
  const bool sound =
      in.finished() && header.header.id && header.keyframes <= kMaxKeyframes && header.points <= kMaxPoints;
  if (!sound) return std::nullopt;
  return header;
}

Blob encode_epoch(const EpochRecord& epoch) {
  ByteWriter out;
  out.put(static_cast<uint64_t>(epoch.keyframes));
  out.put(static_cast<uint64_t>(epoch.points));
  return out.take();
}

std::optional<EpochRecord> decode_epoch(int64_t id, std::span<const uint8_t> row) {
  ByteReader in(row);
  EpochRecord epoch{Epoch{static_cast<uint64_t>(id)}, 0, 0};
  epoch.keyframes = in.get<uint64_t>();
  epoch.points = in.get<uint64_t>();
  if (!in.finished()) return std::nullopt;
  return epoch;
}

Blob encode_decision(const DecisionRecord& decision) {
  ByteWriter out;
  out.put_text(decision.client);
  out.put(decision.session.value);
  out.put(decision.seq);
  out.put(static_cast<uint8_t>(decision.kind));
  out.put(decision.decision);
  out.put_text(decision.reason);
  out.put(decision.keyframe.value);
  out.put(decision.time.nanoseconds);
  out.put(static_cast<uint32_t>(decision.seed_points.size()));
  for (const auto& [trail, point] : decision.seed_points) {
    out.put(trail.value);
    out.put(point.value);
  }
  if (decision.kind == CommandKind::kRequest) out.put(decision.label);
  return out.take();
}

std::optional<DecisionRecord> decode_decision(std::span<const uint8_t> row) {
  ByteReader in(row);
  DecisionRecord decision;
  decision.client = in.get_text();
  decision.session.value = in.get<uint64_t>();
  decision.seq = in.get<uint64_t>();
  const auto kind = in.get<uint8_t>();
  decision.decision = in.get<uint8_t>();
  decision.reason = in.get_text();
  decision.keyframe.value = in.get<uint64_t>();
  decision.time.nanoseconds = in.get<int64_t>();
  decision.seed_points.resize(in.get_count(2 * sizeof(uint64_t)));
  for (auto& [trail, point] : decision.seed_points) {
    trail.value = in.get<uint64_t>();
    point.value = in.get<uint64_t>();
  }
  if (kind == static_cast<uint8_t>(CommandKind::kRequest)) decision.label = in.get<uint64_t>();
  const bool sound = in.finished() && is_valid_name(decision.client) && is_enumerator<CommandKind>(kind) &&
                     decision.seed_points.size() <= kMaxTrails;
  if (!sound) return std::nullopt;
  decision.kind = static_cast<CommandKind>(kind);
  return decision;
}

Blob encode_label(const LabelRecord& label) {
  ByteWriter out;
  out.put(static_cast<uint8_t>(label.kind));
  out.put_text(label.text);
  put_pose(label.map_from_label, &out);
  out.put_text(label.author);
  out.put(label.time.nanoseconds);
  out.put(label.anchor.value);
  put_pose(label.anchor_from_label, &out);
  return out.take();
}

std::optional<LabelRecord> decode_label(int64_t id, std::span<const uint8_t> row) {
  ByteReader in(row);
  LabelRecord label;
  label.id = static_cast<uint64_t>(id);
  const auto kind = in.get<uint8_t>();
  const std::string text = in.get_text();
  // Of another program, or kept before texts were checked: nothing is lost for it.
  label.text = cut_text(one_line(text), kMaxLabelBytes);
  const auto map_from_label = get_pose(&in);
  label.author = cut_text(one_line(in.get_text()), kMaxAuthorBytes);
  label.time.nanoseconds = in.get<int64_t>();
  label.anchor.value = in.get<uint64_t>();
  const auto anchor_from_label = get_pose(&in);
  const bool sound = in.finished() && id > 0 && is_time(label.time) && map_from_label && anchor_from_label &&
                     is_enumerator<LabelKind>(kind) && text.size() <= kMaxLabelBytes;
  if (!sound) return std::nullopt;
  label.kind = static_cast<LabelKind>(kind);
  label.map_from_label = *map_from_label;
  label.anchor_from_label = *anchor_from_label;
  return label;
}

Blob encode_contributor(const std::string& client) {
  ByteWriter out;
  out.put_text(client);
  return out.take();
}

std::optional<std::string> decode_contributor(std::span<const uint8_t> row) {
  ByteReader in(row);
  std::string client = in.get_text();
  if (!in.finished() || !is_valid_name(client)) return std::nullopt;
  return client;
}

Blob encode_tag(const MapTag& tag) {
  ByteWriter out;
  out.put_text(tag.name);
  out.put(tag.time.nanoseconds);
  out.put_text(tag.author);
  for (const size_t count : {tag.keyframes, tag.points, tag.keyframe_count, tag.point_count})
    out.put(static_cast<uint64_t>(count));
  out.put(tag.epoch.value);
  return out.take();
}

std::optional<MapTag> decode_tag(int64_t id, std::span<const uint8_t> row) {
  ByteReader in(row);
  MapTag tag;
  tag.number = static_cast<uint64_t>(id);
  tag.name = one_line(in.get_text());
  tag.time.nanoseconds = in.get<int64_t>();
  tag.author = one_line(in.get_text());
  for (size_t* count : {&tag.keyframes, &tag.points, &tag.keyframe_count, &tag.point_count})
    *count = in.get<uint64_t>();
  if (in.left() > 0) tag.epoch.value = in.get<uint64_t>();  // since schema 8
  const bool sound = in.finished() && tag.keyframe_count <= kMaxKeyframes && tag.point_count <= kMaxPoints;
  if (!sound) return std::nullopt;
  return tag;
}

Blob encode_overlap(const OverlapRecord& overlap) {
  ByteWriter out;
  out.put(std::span(overlap.one.bytes));
  out.put(std::span(overlap.other.bytes));
  out.put(overlap.of_one);
  out.put(overlap.of_other);
  out.put(overlap.found.nanoseconds);
  return out.take();
}

std::optional<OverlapRecord> decode_overlap(std::span<const uint8_t> row) {
  ByteReader in(row);
  OverlapRecord overlap;
  in.get(std::span(overlap.one.bytes));
  in.get(std::span(overlap.other.bytes));
  overlap.of_one = in.get<uint32_t>();
  overlap.of_other = in.get<uint32_t>();
  overlap.found.nanoseconds = in.get<int64_t>();
  const bool sound = in.finished() && overlap.one && overlap.one < overlap.other &&
                     overlap.of_one <= kMaxKeyframes && overlap.of_other <= kMaxKeyframes;
  if (!sound) return std::nullopt;
  return overlap;
}

}  // namespace cairn
