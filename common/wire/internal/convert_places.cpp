// SPDX-License-Identifier: Apache-2.0
// Conversion of relocalization queries and their answers.
#include <numeric>

#include "common/image/pyramid.h"
#include "common/wire/internal/convert_common.h"

namespace cairn::wire::internal {
namespace {

constexpr uint32_t kMaxSmallSide = kMaxImageSide >> (kPyramidLevels - 1);
static_assert(std::accumulate(kPlaceCorners.begin(), kPlaceCorners.end(), size_t{0}) <= kMaxPlaceCorners);

}  // namespace

// ---- RelocQuery

template <>
cairn_RelocQuery encode(const RelocQuery& message, Scratch* scratch) {
  cairn_RelocQuery sample{};
  put_id(message.client.bytes, sample.client_id);
  sample.schema_version = kSchemaVersion;
  sample.command = {message.command.session.value, message.command.seq};
  put_id(message.map_hint.bytes, sample.map_hint);
  sample.camera_id = message.camera;
  sample.camera_version = message.camera_version;
  sample.lockstep = message.lockstep;
  sample.time = message.time.nanoseconds;
  sample.small_image = encode_image(message.small_image);
  fill_sequence(message.corners.size(), scratch, &sample.corners, [&](size_t i, cairn_PlaceCorner& out) {
    const PlaceCorner& corner = message.corners[i];
    std::copy(corner.descriptor.begin(), corner.descriptor.end(), out.descriptor);
    put_vector(corner.pixel, out.pixel);
    out.level = corner.level;
  });
  sample.up = encode_up(message.up);
  return sample;
}

template <>
RelocQuery decode_key<RelocQuery>(const cairn_RelocQuery& sample) {
  RelocQuery message;
  message.client = get_id<ClientId>(sample.client_id);
  return message;
}

template <>
Result<RelocQuery> decode<RelocQuery>(const cairn_RelocQuery& sample) {
  Check check;
  check.schema(sample.schema_version);
  check.command(sample.command);
  check.image(sample.small_image);
  const cairn_Image& small = sample.small_image;
  check.require(small.encoding == static_cast<uint8_t>(ImageEncoding::kRaw) && small.width <= kMaxSmallSide &&
                    small.height <= kMaxSmallSide,
                "not a small raw image");
  check.count(sample.corners, kMaxPlaceCorners);
  check.up(sample.up);
  check.time(sample.time);
  if (!check.passed()) return unfit(check.what());
  RelocQuery message = decode_key<RelocQuery>(sample);
  message.command = decode_command(sample.command);
  message.map_hint = get_id<MapId>(sample.map_hint);
  message.camera = sample.camera_id;
  message.camera_version = sample.camera_version;
  message.lockstep = sample.lockstep;
  message.time = {sample.time};
  message.small_image = decode_image(small);
  message.corners.resize(sample.corners._length);
  for (uint32_t i = 0; i < sample.corners._length; ++i) {
    const cairn_PlaceCorner& corner = sample.corners._buffer[i];
    check.pixel(corner.pixel);
    check.require(corner.level < kPyramidLevels, "unknown pyramid level");
    PlaceCorner& out = message.corners[i];
    std::copy(std::begin(corner.descriptor), std::end(corner.descriptor), out.descriptor.begin());
    out.pixel = get_vector(corner.pixel);
    out.level = corner.level;
  }
  message.up = decode_up(sample.up);
  return checked_message(check, std::move(message));
}

template <>
size_t payload_bytes<RelocQuery>(const cairn_RelocQuery& sample) {
  return sizeof(sample) + sequence_bytes(sample.small_image.bytes) + sequence_bytes(sample.corners);
}

// ---- RelocAnswer

template <>
cairn_RelocAnswer encode(const RelocAnswer& message, Scratch* scratch) {
  cairn_RelocAnswer sample{};
  put_id(message.client.bytes, sample.client_id);
  sample.schema_version = kSchemaVersion;
  sample.command = {message.command.session.value, message.command.seq};
  sample.verdict = static_cast<uint8_t>(message.answer.verdict);
  sample.reason = borrow(message.answer.reason);
  const auto& candidates = message.answer.candidates;
  fill_sequence(candidates.size(), scratch, &sample.candidates, [&](size_t i, cairn_PlaceCandidate& out) {
    const PlaceCandidate& candidate = candidates[i];
    put_id(candidate.map.bytes, out.map_id);
    out.epoch = candidate.epoch.value;
    out.revision = candidate.revision.value;
    out.keyframe = candidate.keyframe.value;
    out.camera_from_keyframe = encode_pose(candidate.camera_from_keyframe);
    out.score = candidate.score;
    out.matches = static_cast<uint32_t>(candidate.matches);
    out.inliers = static_cast<uint32_t>(candidate.inliers);
    out.expected = static_cast<uint32_t>(candidate.expected);
    out.confirmed = candidate.confirmed;
    out.reason = borrow(candidate.reason);
  });
  return sample;
}

template <>
RelocAnswer decode_key<RelocAnswer>(const cairn_RelocAnswer& sample) {
  RelocAnswer message;
  message.client = get_id<ClientId>(sample.client_id);
  return message;
}

template <>
Result<RelocAnswer> decode<RelocAnswer>(const cairn_RelocAnswer& sample) {
  Check check;
  check.schema(sample.schema_version);
  check.command(sample.command);
  check.require(is_enumerator<RelocalizationVerdict>(sample.verdict), "unknown verdict");
  check.text(sample.reason, kMaxReasonBytes);
  check.count(sample.candidates, kMaxPlaceCandidates);
  if (!check.passed()) return unfit(check.what());
  RelocAnswer message = decode_key<RelocAnswer>(sample);
  message.command = decode_command(sample.command);
  message.answer.verdict = static_cast<RelocalizationVerdict>(sample.verdict);
  message.answer.reason = get_text(sample.reason);
  check.require(!has_place(message.answer.verdict) || sample.candidates._length > 0,
                "a place without a candidate");
  for (uint32_t i = 0; i < sample.candidates._length; ++i) {
    const cairn_PlaceCandidate& candidate = sample.candidates._buffer[i];
    check.pose(candidate.camera_from_keyframe);
    check.length(candidate.score);
    check.require(candidate.matches <= kMaxMeasurements && candidate.inliers <= kMaxMeasurements &&
                      candidate.expected <= kMaxPoints,
                  "count out of range");
    check.text(candidate.reason, kMaxReasonBytes);
    if (!check.passed()) break;
    message.answer.candidates.push_back({get_id<MapId>(candidate.map_id),
                                         {candidate.epoch},
                                         {candidate.revision},
                                         {candidate.keyframe},
                                         decode_pose(candidate.camera_from_keyframe),
                                         candidate.score,
                                         static_cast<int>(candidate.matches),
                                         static_cast<int>(candidate.inliers),
                                         static_cast<int>(candidate.expected),
                                         candidate.confirmed,
                                         get_text(candidate.reason)});
  }
  return checked_message(check, std::move(message));
}

template <>
size_t payload_bytes<RelocAnswer>(const cairn_RelocAnswer& sample) {
  size_t bytes = sizeof(sample) + text_bytes(sample.reason) + sequence_bytes(sample.candidates);
  for (uint32_t i = 0; i < sample.candidates._length; ++i) {
    bytes += text_bytes(sample.candidates._buffer[i].reason);
  }
  return bytes;
}

}  // namespace cairn::wire::internal
