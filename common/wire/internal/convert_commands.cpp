// SPDX-License-Identifier: Apache-2.0
// Conversion of what clients send, and of the verdicts on it.
#include "common/image/pyramid.h"
#include "common/wire/internal/convert_common.h"

namespace cairn::wire::internal {
namespace {

/// Camera and CameraEstimate say the same of a camera.
template <typename Sample, typename Message>
Sample encode_camera(const Message& message) {
  Sample sample{};
  put_id(message.client.bytes, sample.client_id);
  sample.camera_id = message.camera;
  sample.schema_version = kSchemaVersion;
  sample.version = message.version;
  sample.model = static_cast<uint8_t>(message.parameters.model);
  sample.width = static_cast<uint32_t>(message.parameters.width);
  sample.height = static_cast<uint32_t>(message.parameters.height);
  borrow_sequence(message.parameters.values, &sample.values);
  borrow_sequence(message.sigma, &sample.sigma);
  sample.frozen = message.frozen;
  return sample;
}

template <typename Message, typename Sample>
Message decode_camera_key(const Sample& sample) {
  Message message;
  message.client = get_id<ClientId>(sample.client_id);
  message.camera = sample.camera_id;
  return message;
}

template <typename Message, typename Sample>
Result<Message> decode_camera(const Sample& sample) {
  Check check;
  check.schema(sample.schema_version);
  check.require(is_camera_model(sample.model), "unknown camera model");
  check.require(sample.width >= 1 && sample.width <= kMaxImageSide && sample.height >= 1 &&
                    sample.height <= kMaxImageSide,
                "camera size out of range");
  check.count(sample.values, kMaxCameraValues);
  check.require(sample.sigma._length == 0 || sample.sigma._length == sample.values._length,
                "sigma of another length");
  if (!check.passed()) return unfit(check.what());
  auto message = decode_camera_key<Message>(sample);
  message.version = sample.version;
  message.parameters = {static_cast<CameraModel>(sample.model), static_cast<int>(sample.width),
                        static_cast<int>(sample.height), get_sequence<double>(sample.values)};
  message.sigma = get_sequence<double>(sample.sigma);
  message.frozen = sample.frozen;
  for (const double value : message.parameters.values) check.length(value);
  for (const double value : message.sigma) check.distance(value);
  return checked_message(check, std::move(message));
}

}  // namespace

// ---- Camera

template <>
cairn_Camera encode(const CameraMessage& message, Scratch*) {
  return encode_camera<cairn_Camera>(message);
}

template <>
CameraMessage decode_key<CameraMessage>(const cairn_Camera& sample) {
  return decode_camera_key<CameraMessage>(sample);
}

template <>
Result<CameraMessage> decode<CameraMessage>(const cairn_Camera& sample) {
  return decode_camera<CameraMessage>(sample);
}

template <>
size_t payload_bytes<CameraMessage>(const cairn_Camera& sample) {
  return sizeof(sample) + sequence_bytes(sample.values) + sequence_bytes(sample.sigma);
}

// ---- CameraEstimate

template <>
cairn_CameraEstimate encode(const CameraEstimate& message, Scratch*) {
  auto sample = encode_camera<cairn_CameraEstimate>(message);
  put_id(message.map.bytes, sample.map_id);
  sample.epoch = message.epoch.value;
  sample.cannot_be_known = message.cannot_be_known;
  return sample;
}

template <>
CameraEstimate decode_key<CameraEstimate>(const cairn_CameraEstimate& sample) {
  auto message = decode_camera_key<CameraEstimate>(sample);
  message.map = get_id<MapId>(sample.map_id);
  return message;
}

template <>
Result<CameraEstimate> decode<CameraEstimate>(const cairn_CameraEstimate& sample) {
  auto message = decode_camera<CameraEstimate>(sample);
  if (!message) return message;
  message->map = get_id<MapId>(sample.map_id);
  message->epoch = Epoch{sample.epoch};
  message->cannot_be_known = sample.cannot_be_known;
  return message;
}

template <>
size_t payload_bytes<CameraEstimate>(const cairn_CameraEstimate& sample) {
  return sizeof(sample) + sequence_bytes(sample.values) + sequence_bytes(sample.sigma);
}

// ---- MapSeed

template <>
cairn_MapSeed encode(const MapSeed& message, Scratch* scratch) {
  cairn_MapSeed sample{};
  put_id(message.client.bytes, sample.client_id);
  sample.schema_version = kSchemaVersion;
  sample.command = {message.command.session.value, message.command.seq};
  sample.camera_id = message.camera;
  sample.camera_version = message.camera_version;
  sample.lockstep = message.lockstep;
  sample.first_time = message.first_time.nanoseconds;
  sample.second_time = message.second_time.nanoseconds;
  sample.first_image = encode_image(message.first_image);
  sample.second_image = encode_image(message.second_image);
  fill_sequence(message.trails.size(), scratch, &sample.trails, [&](size_t i, cairn_Trail& out) {
    const Trail& trail = message.trails[i];
    out.id = trail.id.value;
    put_vector(trail.first, out.first);
    put_vector(trail.second, out.second);
  });
  sample.second_from_first = encode_pose(message.second_from_first);
  sample.map_name = borrow(message.map_name);
  borrow_sequence(message.still_mask, &sample.still_mask);
  sample.second_up = encode_up(message.second_up);
  return sample;
}

template <>
MapSeed decode_key<MapSeed>(const cairn_MapSeed& sample) {
  MapSeed message;
  message.client = get_id<ClientId>(sample.client_id);
  return message;
}

template <>
Result<MapSeed> decode<MapSeed>(const cairn_MapSeed& sample) {
  Check check;
  check.schema(sample.schema_version);
  check.command(sample.command);
  check.image(sample.first_image);
  check.image(sample.second_image);
  check.require(sample.first_image.width == sample.second_image.width &&
                    sample.first_image.height == sample.second_image.height,
                "images of unequal size");
  check.count(sample.trails, kMaxTrails);
  check.pose(sample.second_from_first);
  check.text(sample.map_name, kMaxNameBytes);
  check.still_mask(sample.still_mask, sample.first_image);
  check.up(sample.second_up);
  check.time(sample.first_time);
  check.time(sample.second_time);
  if (!check.passed()) return unfit(check.what());
  MapSeed message = decode_key<MapSeed>(sample);
  message.command = decode_command(sample.command);
  message.camera = sample.camera_id;
  message.camera_version = sample.camera_version;
  message.lockstep = sample.lockstep;
  message.first_time = {sample.first_time};
  message.second_time = {sample.second_time};
  message.first_image = decode_image(sample.first_image);
  message.second_image = decode_image(sample.second_image);
  message.trails.reserve(sample.trails._length);
  for (uint32_t i = 0; i < sample.trails._length; ++i) {
    const cairn_Trail& trail = sample.trails._buffer[i];
    check.pixel(trail.first);
    check.pixel(trail.second);
    message.trails.push_back({{trail.id}, get_vector(trail.first), get_vector(trail.second)});
  }
  message.second_from_first = decode_pose(sample.second_from_first);
  message.map_name = get_text(sample.map_name);
  message.still_mask = get_sequence<uint8_t>(sample.still_mask);
  message.second_up = decode_up(sample.second_up);
  return checked_message(check, std::move(message));
}

template <>
size_t payload_bytes<MapSeed>(const cairn_MapSeed& sample) {
  return sizeof(sample) + sequence_bytes(sample.first_image.bytes) +
         sequence_bytes(sample.second_image.bytes) + sequence_bytes(sample.trails) +
         text_bytes(sample.map_name) + sequence_bytes(sample.still_mask);
}

// ---- KeyframeOffer

template <>
cairn_KeyframeOffer encode(const KeyframeOffer& message, Scratch* scratch) {
  cairn_KeyframeOffer sample{};
  put_id(message.client.bytes, sample.client_id);
  sample.schema_version = kSchemaVersion;
  sample.command = {message.command.session.value, message.command.seq};
  put_id(message.map.bytes, sample.map_id);
  sample.epoch = message.epoch.value;
  sample.revision = message.revision.value;
  sample.reference = message.reference.value;
  sample.camera_from_reference = encode_pose(message.camera_from_reference);
  sample.camera_id = message.camera;
  sample.camera_version = message.camera_version;
  sample.lockstep = message.lockstep;
  sample.time = message.time.nanoseconds;
  sample.picture = encode_image(message.image);
  fill_sequence(message.measurements.size(), scratch, &sample.measurements,
                [&](size_t i, cairn_PointMeasurement& out) {
                  out.id = message.measurements[i].id.value;
                  out.level = message.measurements[i].level;
                  put_vector(message.measurements[i].pixel, out.pixel);
                });
  fill_sequence(message.candidates.size(), scratch, &sample.candidates,
                [&](size_t i, cairn_PointCandidate& out) {
                  const PointCandidate& candidate = message.candidates[i];
                  out.id = candidate.id.value;
                  put_vector(candidate.pixel, out.pixel);
                  out.inverse_depth = candidate.inverse_depth;
                  out.sigma = candidate.sigma;
                  out.level = candidate.level;
                });
  sample.reference_command = message.reference_command;
  borrow_sequence(message.still_mask, &sample.still_mask);
  sample.up = encode_up(message.up);
  sample.as_proposal = message.as_proposal;
  return sample;
}

template <>
KeyframeOffer decode_key<KeyframeOffer>(const cairn_KeyframeOffer& sample) {
  KeyframeOffer message;
  message.client = get_id<ClientId>(sample.client_id);
  return message;
}

template <>
Result<KeyframeOffer> decode<KeyframeOffer>(const cairn_KeyframeOffer& sample) {
  Check check;
  check.schema(sample.schema_version);
  check.command(sample.command);
  check.pose(sample.camera_from_reference);
  check.image(sample.picture);
  check.count(sample.measurements, kMaxMeasurements);
  check.count(sample.candidates, kMaxCandidates);
  check.require(sample.reference_command < sample.command.seq, "refers to an offer that is not earlier");
  check.still_mask(sample.still_mask, sample.picture);
  check.up(sample.up);
  check.time(sample.time);
  if (!check.passed()) return unfit(check.what());
  KeyframeOffer message = decode_key<KeyframeOffer>(sample);
  message.command = decode_command(sample.command);
  message.map = get_id<MapId>(sample.map_id);
  message.epoch = {sample.epoch};
  message.revision = {sample.revision};
  message.reference = {sample.reference};
  message.camera_from_reference = decode_pose(sample.camera_from_reference);
  message.camera = sample.camera_id;
  message.camera_version = sample.camera_version;
  message.lockstep = sample.lockstep;
  message.time = {sample.time};
  message.image = decode_image(sample.picture);
  message.measurements.reserve(sample.measurements._length);
  for (uint32_t i = 0; i < sample.measurements._length; ++i) {
    const cairn_PointMeasurement& found = sample.measurements._buffer[i];
    check.pixel(found.pixel);
    check.require(found.level < kPyramidLevels, "unknown pyramid level");
    message.measurements.push_back({{found.id}, found.level, get_vector(found.pixel)});
  }
  message.candidates.reserve(sample.candidates._length);
  for (uint32_t i = 0; i < sample.candidates._length; ++i) {
    const cairn_PointCandidate& candidate = sample.candidates._buffer[i];
    check.pixel(candidate.pixel);
    check.require(candidate.level < kPyramidLevels, "unknown pyramid level");
    check.distance(candidate.inverse_depth);
    check.distance(candidate.sigma);
    check.require(candidate.inverse_depth > 0 && candidate.sigma > 0, "a candidate without depth or sigma");
    message.candidates.push_back({{candidate.id},
                                  candidate.level,
                                  get_vector(candidate.pixel),
                                  candidate.inverse_depth,
                                  candidate.sigma});
  }
  message.reference_command = sample.reference_command;
  message.still_mask = get_sequence<uint8_t>(sample.still_mask);
  message.up = decode_up(sample.up);
  message.as_proposal = sample.as_proposal;
  return checked_message(check, std::move(message));
}

template <>
size_t payload_bytes<KeyframeOffer>(const cairn_KeyframeOffer& sample) {
  return sizeof(sample) + sequence_bytes(sample.picture.bytes) + sequence_bytes(sample.measurements) +
         sequence_bytes(sample.candidates) + sequence_bytes(sample.still_mask);
}

// ---- TrackerState

template <>
cairn_TrackerState encode(const TrackerStateMessage& message, Scratch*) {
  cairn_TrackerState sample{};
  put_id(message.client.bytes, sample.client_id);
  sample.schema_version = kSchemaVersion;
  sample.session = message.session.value;
  sample.state = static_cast<uint8_t>(message.state);
  put_id(message.map.bytes, sample.map_id);
  sample.epoch = message.epoch.value;
  sample.revision = message.revision.value;
  sample.camera_from_map = encode_pose(message.camera_from_map);
  sample.quality = message.quality;
  sample.frame_time = message.frame_time.nanoseconds;
  sample.wearer = borrow(message.wearer);
  return sample;
}

template <>
TrackerStateMessage decode_key<TrackerStateMessage>(const cairn_TrackerState& sample) {
  TrackerStateMessage message;
  message.client = get_id<ClientId>(sample.client_id);
  return message;
}

template <>
Result<TrackerStateMessage> decode<TrackerStateMessage>(const cairn_TrackerState& sample) {
  Check check;
  check.schema(sample.schema_version);
  check.require(sample.session != 0, "no session");
  check.require(is_enumerator<TrackingState>(sample.state), "unknown tracking state");
  check.pose(sample.camera_from_map);
  check.require(sample.quality >= 0 && sample.quality <= 1, "quality out of range");
  check.time(sample.frame_time);
  const std::string wearer = get_text(sample.wearer);
  check.require(wearer.empty() || is_valid_name(wearer), "no name of a wearer");
  TrackerStateMessage message = decode_key<TrackerStateMessage>(sample);
  message.session = {sample.session};
  message.state = static_cast<TrackingState>(sample.state);
  message.map = get_id<MapId>(sample.map_id);
  message.epoch = {sample.epoch};
  message.revision = {sample.revision};
  message.camera_from_map = decode_pose(sample.camera_from_map);
  message.quality = sample.quality;
  message.frame_time = {sample.frame_time};
  message.wearer = wearer;
  return checked_message(check, std::move(message));
}

template <>
size_t payload_bytes<TrackerStateMessage>(const cairn_TrackerState& sample) {
  return sizeof(sample) + text_bytes(sample.wearer);
}

// ---- SeedVerdict

template <>
cairn_SeedVerdict encode(const SeedVerdict& message, Scratch* scratch) {
  cairn_SeedVerdict sample{};
  put_id(message.client.bytes, sample.client_id);
  sample.schema_version = kSchemaVersion;
  sample.command = {message.command.session.value, message.command.seq};
  sample.accepted = message.accepted;
  sample.reason = borrow(message.reason);
  put_id(message.map.bytes, sample.map_id);
  sample.epoch = message.epoch.value;
  sample.revision = message.revision.value;
  sample.first_keyframe = message.first_keyframe.value;
  sample.second_keyframe = message.second_keyframe.value;
  fill_sequence(message.points.size(), scratch, &sample.points, [&](size_t i, cairn_TrailPoint& out) {
    out = {message.points[i].first.value, message.points[i].second.value};
  });
  return sample;
}

template <>
SeedVerdict decode_key<SeedVerdict>(const cairn_SeedVerdict& sample) {
  SeedVerdict message;
  message.client = get_id<ClientId>(sample.client_id);
  return message;
}

template <>
Result<SeedVerdict> decode<SeedVerdict>(const cairn_SeedVerdict& sample) {
  Check check;
  check.schema(sample.schema_version);
  check.text(sample.reason, kMaxReasonBytes);
  check.count(sample.points, kMaxTrails);
  if (!check.passed()) return unfit(check.what());
  SeedVerdict message = decode_key<SeedVerdict>(sample);
  message.command = decode_command(sample.command);
  message.accepted = sample.accepted;
  message.reason = get_text(sample.reason);
  message.map = get_id<MapId>(sample.map_id);
  message.epoch = {sample.epoch};
  message.revision = {sample.revision};
  message.first_keyframe = {sample.first_keyframe};
  message.second_keyframe = {sample.second_keyframe};
  message.points.reserve(sample.points._length);
  for (uint32_t i = 0; i < sample.points._length; ++i) {
    message.points.emplace_back(TrailId{sample.points._buffer[i].trail},
                                PointId{sample.points._buffer[i].point});
  }
  return message;
}

template <>
size_t payload_bytes<SeedVerdict>(const cairn_SeedVerdict& sample) {
  return sizeof(sample) + text_bytes(sample.reason) + sequence_bytes(sample.points);
}

// ---- OfferVerdict

template <>
cairn_OfferVerdict encode(const OfferVerdict& message, Scratch* scratch) {
  auto sample = encode_decided<cairn_OfferVerdict>(message);
  fill_sequence(message.recent.size(), scratch, &sample.recent, [&](size_t i, cairn_OfferOutcome& out) {
    const OfferOutcome& outcome = message.recent[i];
    out.seq = outcome.seq;
    out.decision = static_cast<uint8_t>(outcome.decision);
    out.reason = borrow(outcome.reason);
    put_id(outcome.map.bytes, out.map_id);
    out.keyframe = outcome.keyframe.value;
    out.epoch = outcome.epoch.value;
    out.revision = outcome.revision.value;
  });
  return sample;
}

template <>
OfferVerdict decode_key<OfferVerdict>(const cairn_OfferVerdict& sample) {
  OfferVerdict message;
  message.client = get_id<ClientId>(sample.client_id);
  return message;
}

template <>
Result<OfferVerdict> decode<OfferVerdict>(const cairn_OfferVerdict& sample) {
  Check check;
  auto message = decode_decided<OfferVerdict>(sample, &check);
  if (!message) return message;
  for (uint32_t i = 0; i < sample.recent._length; ++i) {
    const cairn_OfferOutcome& outcome = sample.recent._buffer[i];
    check.require(is_enumerator<OfferDecision>(outcome.decision), "unknown decision");
    check.text(outcome.reason, kMaxReasonBytes);
    message->recent.push_back({outcome.seq,
                               static_cast<OfferDecision>(outcome.decision),
                               get_text(outcome.reason),
                               get_id<MapId>(outcome.map_id),
                               {outcome.keyframe},
                               {outcome.epoch},
                               {outcome.revision}});
  }
  return checked_message(check, *std::move(message));
}

template <>
size_t payload_bytes<OfferVerdict>(const cairn_OfferVerdict& sample) {
  size_t bytes = sizeof(sample) + sequence_bytes(sample.recent);
  for (uint32_t i = 0; i < sample.recent._length; ++i) bytes += text_bytes(sample.recent._buffer[i].reason);
  return bytes;
}

}  // namespace cairn::wire::internal
