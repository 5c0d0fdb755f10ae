// SPDX-License-Identifier: Apache-2.0
// Conversion of what the cameras of one wearer say to each other.
#include "common/map/ids.h"
#include "common/wire/internal/convert_common.h"

namespace cairn::wire::internal {
namespace {

constexpr const char* kNoClient = "not the name of a client";

}  // namespace

// ---- WearerCamera

template <>
cairn_WearerCamera encode(const WearerCamera& message, Scratch*) {
  cairn_WearerCamera sample{};
  sample.name = borrow(message.name);
  sample.schema_version = kSchemaVersion;
  sample.width = message.width;
  sample.height = message.height;
  return sample;
}

template <>
WearerCamera decode_key<WearerCamera>(const cairn_WearerCamera& sample) {
  WearerCamera message;
  message.name = get_text(sample.name);
  return message;
}

template <>
Result<WearerCamera> decode<WearerCamera>(const cairn_WearerCamera& sample) {
  Check check;
  check.schema(sample.schema_version);
  require_name(sample.name, false, kNoClient, &check);
  for (const uint32_t side : {sample.width, sample.height})
    check.require(side >= 1 && side <= kMaxImageSide, "size of frames out of range");
  WearerCamera message = decode_key<WearerCamera>(sample);
  message.width = sample.width;
  message.height = sample.height;
  return checked_message(check, std::move(message));
}

template <>
size_t payload_bytes<WearerCamera>(const cairn_WearerCamera& sample) {
  return sizeof(sample) + text_bytes(sample.name);
}

// ---- PictureRequest

template <>
cairn_PictureRequest encode(const PictureRequest& message, Scratch*) {
  cairn_PictureRequest sample{};
  sample.name = borrow(message.name);
  sample.schema_version = kSchemaVersion;
  sample.camera_name = borrow(message.camera);
  return sample;
}

template <>
PictureRequest decode_key<PictureRequest>(const cairn_PictureRequest& sample) {
  PictureRequest message;
  message.name = get_text(sample.name);
  return message;
}

template <>
Result<PictureRequest> decode<PictureRequest>(const cairn_PictureRequest& sample) {
  Check check;
  check.schema(sample.schema_version);
  require_name(sample.name, false, kNoClient, &check);
  require_name(sample.camera_name, true, kNoClient, &check);
  PictureRequest message = decode_key<PictureRequest>(sample);
  message.camera = get_text(sample.camera_name);
  return checked_message(check, std::move(message));
}

template <>
size_t payload_bytes<PictureRequest>(const cairn_PictureRequest& sample) {
  return sizeof(sample) + text_bytes(sample.name) + text_bytes(sample.camera_name);
}

// ---- CameraPicture

template <>
cairn_CameraPicture encode(const CameraPicture& message, Scratch*) {
  cairn_CameraPicture sample{};
  sample.name = borrow(message.name);
  sample.schema_version = kSchemaVersion;
  sample.time = message.time.nanoseconds;
  sample.state = static_cast<uint8_t>(message.state);
  sample.map_name = borrow(message.map);
  sample.note = borrow(message.note);
  sample.picture = encode_image(message.image);
  return sample;
}

template <>
CameraPicture decode_key<CameraPicture>(const cairn_CameraPicture& sample) {
  CameraPicture message;
  message.name = get_text(sample.name);
  return message;
}

template <>
Result<CameraPicture> decode<CameraPicture>(const cairn_CameraPicture& sample) {
  Check check;
  check.schema(sample.schema_version);
  require_name(sample.name, false, kNoClient, &check);
  check.time(sample.time);
  check.require(is_enumerator<TrackingState>(sample.state), "unknown tracking state");
  check.text(sample.map_name, kMaxNameBytes);
  check.text(sample.note, kMaxCameraPictureNote);
  check.image(sample.picture);
  check.require(sample.picture.encoding == static_cast<uint8_t>(ImageEncoding::kJpeg), "image is no JPEG");
  check.require(sample.picture.width <= kMaxCameraImageSide && sample.picture.height <= kMaxCameraImageSide,
                "image too large");
  check.require(sample.picture.bytes._length <= kMaxCameraImageBytes, "image of too many bytes");
  if (!check.passed()) return unfit(check.what());
  CameraPicture message = decode_key<CameraPicture>(sample);
  message.time = {sample.time};
  message.state = static_cast<TrackingState>(sample.state);
  message.map = get_text(sample.map_name);
  message.note = get_text(sample.note);
  message.image = decode_image(sample.picture);
  return message;
}

template <>
size_t payload_bytes<CameraPicture>(const cairn_CameraPicture& sample) {
  return sizeof(sample) + text_bytes(sample.name) + text_bytes(sample.map_name) + text_bytes(sample.note) +
         sequence_bytes(sample.picture.bytes);
}

}  // namespace cairn::wire::internal
