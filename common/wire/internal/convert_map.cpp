// SPDX-License-Identifier: Apache-2.0
// Conversion of what the server publishes: its status and its maps.
#include "common/image/pyramid.h"
#include "common/wire/internal/convert_common.h"

namespace cairn::wire::internal {
namespace {

static_assert(sizeof(cairn_Patch::pixels) == sizeof(SourcePatch));

void put_patch(const PointSource& point, cairn_Patch* out) {
  out->id = point.id.value;
  out->keyframe = point.keyframe.value;
  put_vector(point.ray_center, out->ray_center);
  put_vector(point.ray_right, out->ray_right);
  put_vector(point.ray_down, out->ray_down);
  put_vector(point.normal, out->normal);
  out->corner[0] = point.corner.x;
  out->corner[1] = point.corner.y;
  out->level = point.level;
  std::copy(point.pixels.begin(), point.pixels.end(), out->pixels);
}

PointSource get_patch(const cairn_Patch& patch, Check* check) {
  check->require(patch.level < kPyramidLevels, "unknown pyramid level");
  check->require(patch.corner[0] >= 0 && patch.corner[0] < kMaxImageSide && patch.corner[1] >= 0 &&
                     patch.corner[1] < kMaxImageSide,
                 "corner outside every image");
  check->unit(patch.ray_center);
  check->unit(patch.ray_right);
  check->unit(patch.ray_down);
  check->unit(patch.normal);
  PointSource point;
  point.id = {patch.id};
  point.keyframe = {patch.keyframe};
  point.level = patch.level;
  point.corner = {patch.corner[0], patch.corner[1]};
  point.ray_center = get_vector(patch.ray_center);
  point.ray_right = get_vector(patch.ray_right);
  point.ray_down = get_vector(patch.ray_down);
  point.normal = get_vector(patch.normal);
  std::copy(std::begin(patch.pixels), std::end(patch.pixels), point.pixels.begin());
  return point;
}

PointVisibility get_visibility(const cairn_LocatedPoint& point, Check* check) {
  const Eigen::Vector3f direction = get_vector(point.mean_direction);
  if (direction != Eigen::Vector3f::Zero()) check->unit(point.mean_direction);
  check->require(point.min_cosine >= -1 && point.min_cosine <= 1, "cosine out of range");
  check->distance(point.min_distance);
  check->distance(point.max_distance);
  return {direction, point.min_cosine, point.min_distance, point.max_distance};
}

// What the three topics of blocks have in common.

template <typename DdsBlock, typename Message>
DdsBlock encode_block(const Message& message) {
  DdsBlock sample{};
  put_id(message.map.bytes, sample.map_id);
  sample.block = message.block.index;
  sample.schema_version = kSchemaVersion;
  sample.epoch = message.epoch.value;
  sample.version = message.block.version;
  return sample;
}

/// A replica allocates by index: an absurd one is refused here.
template <typename DdsBlock>
void check_block(const DdsBlock& sample, size_t most_blocks, Check* check) {
  check->schema(sample.schema_version);
  check->require(sample.block < most_blocks, "block index out of range");
}

template <typename Message, typename DdsBlock>
Message decode_block_key(const DdsBlock& sample) {
  Message message;
  message.map = get_id<MapId>(sample.map_id);
  message.block.index = sample.block;
  return message;
}

template <typename Message, typename DdsBlock>
Message decode_block(const DdsBlock& sample) {
  auto message = decode_block_key<Message>(sample);
  message.epoch = {sample.epoch};
  message.block.version = sample.version;
  return message;
}

}  // namespace

// ---- ServerStatus

template <>
cairn_ServerStatus encode(const ServerStatus& message, Scratch*) {
  cairn_ServerStatus sample{};
  sample.schema_version = kSchemaVersion;
  put_id(message.server.bytes, sample.server_id);
  sample.start_count = message.start_count;
  sample.version = borrow(message.version);
  sample.health = borrow(message.health);
  sample.clients = message.clients;
  sample.maps = message.maps;
  sample.load = message.load;
  return sample;
}

template <>
ServerStatus decode_key<ServerStatus>(const cairn_ServerStatus&) {
  return {};
}

template <>
Result<ServerStatus> decode<ServerStatus>(const cairn_ServerStatus& sample) {
  Check check;
  check.schema(sample.schema_version);
  check.text(sample.version, kMaxNameBytes);
  check.text(sample.health, kMaxReasonBytes);
  check.require(sample.load >= 0 && sample.load <= 1, "load out of range");
  return checked_message(
      check, ServerStatus{get_id<ServerId>(sample.server_id), sample.start_count, get_text(sample.version),
                          get_text(sample.health), sample.clients, sample.maps, sample.load});
}

template <>
size_t payload_bytes<ServerStatus>(const cairn_ServerStatus& sample) {
  return sizeof(sample) + text_bytes(sample.version) + text_bytes(sample.health);
}

// ---- MapInfo

template <>
cairn_MapInfo encode(const MapInfo& message, Scratch*) {
  cairn_MapInfo sample{};
  put_id(message.map.bytes, sample.map_id);
  sample.schema_version = kSchemaVersion;
  sample.name = borrow(message.name);
  sample.epoch = message.epoch.value;
  sample.revision = message.revision.value;
  sample.keyframes = message.keyframes;
  sample.points = message.points;
  put_vector(message.bounds_min, sample.bounds_min);
  put_vector(message.bounds_max, sample.bounds_max);
  sample.plane_aligned = message.plane_aligned;
  sample.metric = message.metric;
  sample.right = static_cast<uint8_t>(message.right);
  put_id(message.server.bytes, sample.server_id);
  sample.takes_proposals = message.takes_proposals;
  return sample;
}

template <>
MapInfo decode_key<MapInfo>(const cairn_MapInfo& sample) {
  MapInfo message;
  message.map = get_id<MapId>(sample.map_id);
  return message;
}

template <>
Result<MapInfo> decode<MapInfo>(const cairn_MapInfo& sample) {
  Check check;
  check.schema(sample.schema_version);
  check.text(sample.name, kMaxNameBytes);
  for (size_t i = 0; i < 3; ++i) {
    check.length(sample.bounds_min[i]);
    check.length(sample.bounds_max[i]);
    check.require(sample.bounds_min[i] <= sample.bounds_max[i], "bounds upside down");
  }
  check.require(is_enumerator<MapRight>(sample.right), "unknown right");
  MapInfo message = decode_key<MapInfo>(sample);
  message.name = get_text(sample.name);
  message.epoch = {sample.epoch};
  message.revision = {sample.revision};
  message.keyframes = sample.keyframes;
  message.points = sample.points;
  message.bounds_min = get_vector(sample.bounds_min);
  message.bounds_max = get_vector(sample.bounds_max);
  message.plane_aligned = sample.plane_aligned;
  message.metric = sample.metric;
  message.right = static_cast<MapRight>(sample.right);
  message.server = get_id<ServerId>(sample.server_id);
  message.takes_proposals = sample.takes_proposals;
  return checked_message(check, std::move(message));
}

template <>
size_t payload_bytes<MapInfo>(const cairn_MapInfo& sample) {
  return sizeof(sample) + text_bytes(sample.name);
}

// ---- PointPatches

template <>
cairn_PointPatches encode(const PointPatches& message, Scratch* scratch) {
  auto sample = encode_block<cairn_PointPatches>(message);
  fill_sequence(message.block.points.size(), scratch, &sample.points,
                [&](size_t i, cairn_Patch& out) { put_patch(message.block.points[i], &out); });
  return sample;
}

template <>
PointPatches decode_key<PointPatches>(const cairn_PointPatches& sample) {
  return decode_block_key<PointPatches>(sample);
}

template <>
Result<PointPatches> decode<PointPatches>(const cairn_PointPatches& sample) {
  Check check;
  check_block(sample, kMaxBlocks, &check);
  check.count(sample.points, kBlockSlots);
  if (!check.passed()) return unfit(check.what());
  auto message = decode_block<PointPatches>(sample);
  message.block.points.reserve(sample.points._length);
  PointId previous;
  for (uint32_t i = 0; i < sample.points._length; ++i) {
    message.block.points.push_back(get_patch(sample.points._buffer[i], &check));
    check.require(message.block.points.back().id > previous, "point ids out of order");
    previous = message.block.points.back().id;
  }
  return checked_message(check, std::move(message));
}

template <>
size_t payload_bytes<PointPatches>(const cairn_PointPatches& sample) {
  return sizeof(sample) + sequence_bytes(sample.points);
}

// ---- PointPositions

template <>
cairn_PointPositions encode(const PointPositions& message, Scratch* scratch) {
  auto sample = encode_block<cairn_PointPositions>(message);
  sample.live = message.block.live;
  const size_t count = std::min(message.block.positions.size(), message.block.visibility.size());
  fill_sequence(count, scratch, &sample.points, [&](size_t i, cairn_LocatedPoint& out) {
    const PointVisibility& visibility = message.block.visibility[i];
    put_vector(message.block.positions[i], out.position);
    put_vector(visibility.mean_direction, out.mean_direction);
    out.min_cosine = visibility.min_cosine;
    out.min_distance = visibility.min_distance;
    out.max_distance = visibility.max_distance;
  });
  return sample;
}

template <>
PointPositions decode_key<PointPositions>(const cairn_PointPositions& sample) {
  return decode_block_key<PointPositions>(sample);
}

template <>
Result<PointPositions> decode<PointPositions>(const cairn_PointPositions& sample) {
  Check check;
  check_block(sample, kMaxBlocks, &check);
  check.count(sample.points, kBlockSlots);
  check.live_mask(sample.live, sample.points._length);
  if (!check.passed()) return unfit(check.what());
  auto message = decode_block<PointPositions>(sample);
  message.block.live = sample.live;
  message.block.positions.reserve(sample.points._length);
  message.block.visibility.reserve(sample.points._length);
  for (uint32_t i = 0; i < sample.points._length; ++i) {
    const cairn_LocatedPoint& point = sample.points._buffer[i];
    for (const float value : point.position) check.length(value);
    message.block.positions.push_back(get_vector(point.position));
    message.block.visibility.push_back(get_visibility(point, &check));
  }
  return checked_message(check, std::move(message));
}

template <>
size_t payload_bytes<PointPositions>(const cairn_PointPositions& sample) {
  return sizeof(sample) + sequence_bytes(sample.points);
}

// ---- KeyframePoses

template <>
cairn_KeyframePoses encode(const KeyframePoses& message, Scratch* scratch) {
  auto sample = encode_block<cairn_KeyframePoses>(message);
  sample.live = message.block.live;
  fill_sequence(message.block.keyframes.size(), scratch, &sample.keyframes,
                [&](size_t i, cairn_PosedKeyframe& out) {
                  const KeyframePose& keyframe = message.block.keyframes[i];
                  out.id = keyframe.id.value;
                  out.camera_from_map = encode_pose(keyframe.camera_from_map);
                  out.mean_depth = keyframe.mean_depth;
                });
  return sample;
}

template <>
KeyframePoses decode_key<KeyframePoses>(const cairn_KeyframePoses& sample) {
  return decode_block_key<KeyframePoses>(sample);
}

template <>
Result<KeyframePoses> decode<KeyframePoses>(const cairn_KeyframePoses& sample) {
  Check check;
  check_block(sample, kMaxKeyframeBlocks, &check);
  check.count(sample.keyframes, kBlockSlots);
  check.live_mask(sample.live, sample.keyframes._length);
  if (!check.passed()) return unfit(check.what());
  auto message = decode_block<KeyframePoses>(sample);
  message.block.live = sample.live;
  message.block.keyframes.reserve(sample.keyframes._length);
  KeyframeId previous;
  for (uint32_t i = 0; i < sample.keyframes._length; ++i) {
    const cairn_PosedKeyframe& keyframe = sample.keyframes._buffer[i];
    check.require(KeyframeId{keyframe.id} > previous, "keyframe ids out of order");
    check.pose(keyframe.camera_from_map);
    check.distance(keyframe.mean_depth);
    previous = {keyframe.id};
    message.block.keyframes.push_back({previous, decode_pose(keyframe.camera_from_map), keyframe.mean_depth});
  }
  return checked_message(check, std::move(message));
}

template <>
size_t payload_bytes<KeyframePoses>(const cairn_KeyframePoses& sample) {
  return sizeof(sample) + sequence_bytes(sample.keyframes);
}

// ---- MapCommit

template <>
cairn_MapCommit encode(const MapCommit& message, Scratch* scratch) {
  cairn_MapCommit sample{};
  put_id(message.map.bytes, sample.map_id);
  sample.schema_version = kSchemaVersion;
  sample.name = borrow(message.name);
  sample.epoch = message.epoch.value;
  sample.revision = message.revision.value;
  sample.metric = message.metric;
  fill_sequence(message.points.size(), scratch, &sample.points, [&](size_t i, cairn_BlockVersion& out) {
    out = {message.points[i].index, message.points[i].patches, message.points[i].positions};
  });
  borrow_sequence(message.keyframe_versions, &sample.keyframe_versions);
  fill_sequence(message.cameras.size(), scratch, &sample.cameras, [&](size_t i, cairn_CameraVersion& out) {
    put_id(message.cameras[i].client.bytes, out.client_id);
    out.camera_id = message.cameras[i].camera;
    out.version = message.cameras[i].version;
  });
  return sample;
}

template <>
MapCommit decode_key<MapCommit>(const cairn_MapCommit& sample) {
  MapCommit message;
  message.map = get_id<MapId>(sample.map_id);
  return message;
}

template <>
Result<MapCommit> decode<MapCommit>(const cairn_MapCommit& sample) {
  Check check;
  check.schema(sample.schema_version);
  check.text(sample.name, kMaxNameBytes);
  check.count(sample.points, kMaxBlocks);
  check.count(sample.keyframe_versions, kMaxKeyframeBlocks);
  check.count(sample.cameras, kMaxCalibratedCameras);
  if (!check.passed()) return unfit(check.what());
  MapCommit message = decode_key<MapCommit>(sample);
  message.name = get_text(sample.name);
  message.epoch = {sample.epoch};
  message.revision = {sample.revision};
  message.metric = sample.metric;
  message.points.reserve(sample.points._length);
  for (uint32_t i = 0; i < sample.points._length; ++i) {
    const cairn_BlockVersion& version = sample.points._buffer[i];
    check.require(version.index == i, "block listed out of place");
    message.points.push_back({version.index, version.patches, version.positions});
  }
  message.keyframe_versions = get_sequence<uint64_t>(sample.keyframe_versions);
  for (uint32_t i = 0; i < sample.cameras._length; ++i) {
    const cairn_CameraVersion& camera = sample.cameras._buffer[i];
    message.cameras.push_back({get_id<ClientId>(camera.client_id), camera.camera_id, camera.version});
  }
  return checked_message(check, std::move(message));
}

template <>
size_t payload_bytes<MapCommit>(const cairn_MapCommit& sample) {
  return sizeof(sample) + text_bytes(sample.name) + sequence_bytes(sample.points) +
         sequence_bytes(sample.keyframe_versions) + sequence_bytes(sample.cameras);
}

}  // namespace cairn::wire::internal
