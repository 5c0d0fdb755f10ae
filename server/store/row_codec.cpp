// SPDX-License-Identifier: Apache-2.0
#include "server/store/row_codec.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>

#include "common/base/enumerators.h"
#include "common/geometry/camera_guess.h"
#include "common/image/limits.h"
#include "common/io/image_file.h"
#include "common/map/limits.h"
#include "server/store/bytes.h"

namespace cairn {
namespace {

constexpr size_t kIdBytes = sizeof(uint64_t);

bool is_length(double value) {
  return std::abs(value) <= kMaxLength;  // false for NaN
}

bool is_distance(double value) {
  return value >= 0 && value <= kMaxLength;
}

bool is_direction(const Eigen::Vector3f& vector) {
  return std::abs(vector.norm() - 1) <= kUnitToleranceFloat;
}

bool is_pixel(const Eigen::Vector2f& pixel) {
  return std::abs(pixel.x()) <= kMaxPixel && std::abs(pixel.y()) <= kMaxPixel;
}

bool is_corner(const Corner& corner) {
  return corner.x >= 0 && corner.x < kMaxImageSide && corner.y >= 0 && corner.y < kMaxImageSide;
}

template <typename Id>
void put_ids(const std::vector<Id>& ids, ByteWriter* out) {
  out->put(static_cast<uint32_t>(ids.size()));
  for (const Id id : ids) out->put(id.value);
}

template <typename Id>
std::vector<Id> get_ids(ByteReader* in) {
  std::vector<Id> ids(in->get_count(kIdBytes));
  for (Id& id : ids) id.value = in->get<uint64_t>();
  return ids;
}

}  // namespace

bool is_time(Timestamp time) {
  return time.nanoseconds > -kMaxTime && time.nanoseconds < kMaxTime;
}

void put_pose(const SE3& pose, ByteWriter* out) {
  out->put(Eigen::Vector4d(pose.rotation().coeffs()));
  out->put(pose.translation());
}

std::optional<SE3> get_pose(ByteReader* in) {
  const auto q = in->get_vector<Eigen::Vector4d>();
  const auto t = in->get_vector<Eigen::Vector3d>();
  const bool sound =
      std::abs(q.norm() - 1) < kUnitTolerance && is_length(t.x()) && is_length(t.y()) && is_length(t.z());
  if (!sound) return std::nullopt;
  return SE3(Eigen::Quaterniond(q), t);
}

// ---- camera

Blob encode_camera(const CameraParameters& camera) {
  ByteWriter out;
  out.put(static_cast<uint8_t>(camera.model));
  out.put(static_cast<int32_t>(camera.width));
  out.put(static_cast<int32_t>(camera.height));
  out.put(static_cast<uint32_t>(camera.values.size()));
  for (const double value : camera.values) out.put(value);
  return out.take();
}

std::optional<CameraParameters> decode_camera(std::span<const uint8_t> row) {
  ByteReader in(row);
  CameraParameters camera;
  const auto model = in.get<uint8_t>();
  camera.width = in.get<int32_t>();
  camera.height = in.get<int32_t>();
  camera.values.resize(in.get_count(sizeof(double)));
  for (double& value : camera.values) value = in.get<double>();
  if (!in.finished() || !is_camera_model(model)) return std::nullopt;
  camera.model = static_cast<CameraModel>(model);
  return camera;
}

// ---- calibrated camera

Blob encode_calibrated_camera(const MapCamera& camera) {
  ByteWriter out;
  out.put(std::span(camera.version.client.bytes));
  out.put(camera.version.camera);
  out.put(camera.version.version);
  for (const Intrinsics& i :
       {camera.sigma, camera.prior_mean, camera.prior_sigma, camera.judged, camera.searched})
    out.put(i);
  out.put(static_cast<uint8_t>(camera.frozen));
  out.put(static_cast<uint64_t>(camera.judged_keyframes));
  out.put(static_cast<int32_t>(camera.agreements));
  return out.take();
}

namespace {

/// Whether a camera and what it began from are such as anybody could announce: nobody else checks them.
bool could_be_calibrated(const MapCamera& camera) {
  const CameraParameters& now = camera.camera->parameters();
  const auto could_be = [](const CameraParameters& parameters, const Intrinsics& sigma) {
    const bool has_all = parameters.values.size() == kPriorValues;
    return has_all && intrinsics_prior(parameters, sigma_of_values({parameters, sigma[0], sigma[1]}));
  };
  if (!could_be(now, camera.sigma)) return false;
  const CameraPtr first = with_intrinsics(*camera.camera, camera.prior_mean);
  return first != nullptr && could_be(first->parameters(), camera.prior_sigma);
}

}  // namespace

/// Successive estimates that agree: a few are enough, and nobody counts as far as this.
constexpr int32_t kMostAgreements = 1'000'000;

std::optional<CalibratedCameraRecord> decode_calibrated_camera(int index, std::span<const uint8_t> row,
                                                               const CameraRows& cameras) {
  ByteReader in(row);
  CalibratedCameraRecord record{index, {}};
  MapCamera& camera = record.camera;
  in.get(std::span(camera.version.client.bytes));
  camera.version.camera = in.get<uint32_t>();
  camera.version.version = in.get<uint32_t>();
  bool sound = true;
  for (Intrinsics* i :
       {&camera.sigma, &camera.prior_mean, &camera.prior_sigma, &camera.judged, &camera.searched}) {
    *i = in.get_vector<Intrinsics>();
    sound = sound && i->allFinite();
  }
  const auto frozen = in.get<uint8_t>();
  camera.judged_keyframes = in.get<uint64_t>();
  camera.agreements = in.get<int32_t>();
  const auto values = cameras.find(calibrated_camera_row(index));
  sound = sound && in.finished() && frozen <= 1 && values != cameras.end() && camera.agreements >= 0 &&
          camera.agreements <= kMostAgreements;
  if (!sound) return std::nullopt;
  camera.frozen = frozen == 1;
  camera.camera = values->second;
  if (!could_be_calibrated(camera)) return std::nullopt;
  return record;
}

// ---- keyframe

namespace {

// Bits of a byte that was 0 or 1 before schema 5.
constexpr uint8_t kLive = 1;
constexpr uint8_t kKnowsUp = 2;
constexpr uint8_t kAddsOnly = 4;  // since schema 10

/// False for what no keyframe has.
bool get_up(uint8_t flags, ByteReader* in, std::optional<UpDirection>* up) {
  if ((flags & ~(kLive | kKnowsUp | kAddsOnly)) != 0) return false;
  if ((flags & kKnowsUp) == 0) return true;
  *up = UpDirection{in->get_vector<Eigen::Vector3d>(), in->get<double>()};
  return std::abs((*up)->up.norm() - 1) <= kUnitTolerance && (*up)->sigma > 0 && std::isfinite((*up)->sigma);
}

}  // namespace

Blob encode_keyframe(const KeyframeRecord& keyframe, int64_t camera) {
  ByteWriter out;
  out.put(keyframe.reference.value);
  out.put(camera);
  out.put(keyframe.time.nanoseconds);
  put_pose(keyframe.camera_from_map, &out);
  out.put(keyframe.mean_depth);
  out.put(keyframe.near_depth);
  out.put(keyframe.far_depth);
  out.put(static_cast<uint8_t>((keyframe.live ? kLive : 0) | (keyframe.up ? kKnowsUp : 0) |
                               (keyframe.adds_only ? kAddsOnly : 0)));
  if (keyframe.up) {
    out.put(keyframe.up->up);
    out.put(keyframe.up->sigma);
  }
  out.put(bits_of(keyframe.still));
  return out.take();
}

std::optional<KeyframeRecord> decode_keyframe(KeyframeId id, std::span<const uint8_t> row,
                                              const CameraRows& cameras) {
  ByteReader in(row);
  KeyframeRecord keyframe;
  keyframe.id = id;
  keyframe.reference.value = in.get<uint64_t>();
  const auto camera_row = in.get<int64_t>();
  const auto camera = cameras.find(camera_row);
  keyframe.time.nanoseconds = in.get<int64_t>();
  const auto pose = get_pose(&in);
  keyframe.mean_depth = in.get<double>();
  keyframe.near_depth = in.get<double>();
  keyframe.far_depth = in.get<double>();
  const auto flags = in.get<uint8_t>();
  const bool has_sound_up = get_up(flags, &in, &keyframe.up);
  std::vector<uint8_t> still(in.left());  // none before schema 4, and of most cameras
  in.get(still);
  const bool sound = in.good() && pose && camera != cameras.end() && has_sound_up && is_time(keyframe.time) &&
                     is_distance(keyframe.mean_depth) && is_distance(keyframe.near_depth) &&
                     is_distance(keyframe.far_depth);
  if (!sound) return std::nullopt;
  keyframe.camera = camera->second;
  if (!still.empty()) {
    keyframe.still = still_mask_of(keyframe.camera->width(), keyframe.camera->height(), still);
    if (keyframe.still == nullptr) return std::nullopt;
  }
  if (camera_row < 0) keyframe.estimated_camera = static_cast<int>(calibrated_camera_row(0) - camera_row);
  keyframe.camera_from_map = *pose;
  keyframe.live = (flags & kLive) != 0;
  keyframe.adds_only = (flags & kAddsOnly) != 0;
  return keyframe;
}

// ---- measurements

Blob encode_measurements(const MeasurementsRecord& record) {
  ByteWriter out;
  out.put(static_cast<uint32_t>(record.measurements.size()));
  for (const Measurement& m : record.measurements) {
    out.put(m.point.value);
    out.put(m.level);
    out.put(m.pixel);
  }
  put_ids(record.given_up, &out);
  return out.take();
}

std::optional<MeasurementsRecord> decode_measurements(KeyframeId id, std::span<const uint8_t> row) {
  constexpr size_t kMeasurementBytes = kIdBytes + 1 + 2 * sizeof(float);
  ByteReader in(row);
  MeasurementsRecord record{id, {}, {}};
  record.measurements.resize(in.get_count(kMeasurementBytes));
  bool sound = true;
  PointId last;
  for (Measurement& m : record.measurements) {
    m.point.value = in.get<uint64_t>();
    m.level = in.get<uint8_t>();
    m.pixel = in.get_vector<Eigen::Vector2f>();
    sound = sound && m.point > last && m.level < kPyramidLevels && is_pixel(m.pixel);
    last = m.point;
  }
  record.given_up = get_ids<PointId>(&in);
  if (!in.finished() || !sound) return std::nullopt;
  return record;
}

// ---- points

Blob encode_sources(const SourcesRecord& record) {
  ByteWriter out;
  out.put(static_cast<uint32_t>(record.points.size()));
  for (const PointSource& p : record.points) {
    out.put(p.keyframe.value);
    out.put(p.level);
    out.put(p.corner.x);
    out.put(p.corner.y);
    out.put(p.ray_center);
    out.put(p.ray_right);
    out.put(p.ray_down);
    out.put(p.normal);
    out.put(std::span(p.pixels));
  }
  return out.take();
}

std::optional<SourcesRecord> decode_sources(uint32_t block, std::span<const uint8_t> row) {
  constexpr size_t kSourceBytes =
      kIdBytes + 1 + 2 * sizeof(int16_t) + 4 * 3 * sizeof(float) + kSourcePatchPixels;
  ByteReader in(row);
  SourcesRecord record{block, {}};
  record.points.resize(in.get_count(kSourceBytes));
  bool sound = record.points.size() <= kBlockSlots;
  uint64_t id = uint64_t{block} * kBlockSlots;
  for (PointSource& p : record.points) {
    p.id.value = ++id;
    p.keyframe.value = in.get<uint64_t>();
    p.level = in.get<uint8_t>();
    p.corner.x = in.get<int16_t>();
    p.corner.y = in.get<int16_t>();
    p.ray_center = in.get_vector<Eigen::Vector3f>();
    p.ray_right = in.get_vector<Eigen::Vector3f>();
    p.ray_down = in.get_vector<Eigen::Vector3f>();
    p.normal = in.get_vector<Eigen::Vector3f>();
    in.get(std::span(p.pixels));
    sound = sound && p.level < kPyramidLevels && is_corner(p.corner) && is_direction(p.ray_center) &&
            is_direction(p.ray_right) && is_direction(p.ray_down) && is_direction(p.normal);
  }
  if (!in.finished() || !sound) return std::nullopt;
  return record;
}

Blob encode_positions(const PositionsRecord& record) {
  ByteWriter out;
  out.put(static_cast<uint32_t>(record.points.size()));
  for (const PositionsRecord::Point& p : record.points) {
    out.put(p.position);
    out.put(static_cast<int32_t>(p.attempts));
    out.put(static_cast<int32_t>(p.found));
    out.put(static_cast<uint8_t>(p.live));
  }
  return out.take();
}

std::optional<PositionsRecord> decode_positions(uint32_t block, std::span<const uint8_t> row) {
  constexpr size_t kPositionBytes = 3 * sizeof(double) + 2 * sizeof(int32_t) + 1;
  ByteReader in(row);
  PositionsRecord record{block, {}};
  record.points.resize(in.get_count(kPositionBytes));
  bool sound = record.points.size() <= kBlockSlots;
  for (PositionsRecord::Point& p : record.points) {
    p.position = in.get_vector<Eigen::Vector3d>();
    p.attempts = in.get<int32_t>();
    p.found = in.get<int32_t>();
    p.live = in.get<uint8_t>() != 0;
    const bool somewhere =
        is_length(p.position.x()) && is_length(p.position.y()) && is_length(p.position.z());
    if (!somewhere && !p.live) p.position.setZero();  // a removed point may have been nowhere
    sound = sound && (somewhere || !p.live) && p.attempts >= 0 && p.found >= 0;
  }
  if (!in.finished() || !sound) return std::nullopt;
  return record;
}

// ---- foundation and work

/// A point of the start and its distance, by which the unit of length was held until files had none of them;
/// to programs of that time none says that nothing is held.
constexpr size_t kAnchorBytes = kIdBytes + sizeof(double);

Blob encode_foundation(const FoundationRecord& foundation) {
  ByteWriter out;
  out.put(foundation.min_distance_over_depth);
  out.put(static_cast<uint8_t>(foundation.plane_aligned));
  out.put(uint32_t{0});  // anchors
  return out.take();
}

std::optional<FoundationRecord> decode_foundation(std::span<const uint8_t> row) {
  ByteReader in(row);
  FoundationRecord foundation;
  foundation.min_distance_over_depth = in.get<double>();
  foundation.plane_aligned = in.get<uint8_t>() != 0;
  const size_t anchors = in.get_count(kAnchorBytes);
  for (size_t i = 0; i < anchors; ++i) {
    (void)in.get<uint64_t>();
    (void)in.get<double>();
  }
  const bool sound = foundation.min_distance_over_depth > 0 && is_length(foundation.min_distance_over_depth);
  if (!in.finished() || !sound) return std::nullopt;
  return foundation;
}

namespace {

enum class ExtentKind : uint8_t { kNone, kBox, kSphere, kLast = kSphere };

void put_extent(const std::optional<Extent>& extent, ByteWriter* out) {
  const auto* box = extent ? std::get_if<Box>(&*extent) : nullptr;
  const auto* sphere = extent ? std::get_if<Sphere>(&*extent) : nullptr;
  const ExtentKind kind =
      box != nullptr ? ExtentKind::kBox : (sphere != nullptr ? ExtentKind::kSphere : ExtentKind::kNone);
  out->put(static_cast<uint8_t>(kind));
  if (box != nullptr) {
    out->put(box->min);
    out->put(box->max);
  } else if (sphere != nullptr) {
    out->put(sphere->center);
    out->put(sphere->radius);
  }
}

/// False: it is none that could be.
bool get_extent(ByteReader* in, std::optional<Extent>* extent) {
  const auto kind = in->get<uint8_t>();
  if (!is_enumerator<ExtentKind>(kind)) return false;
  if (kind == static_cast<uint8_t>(ExtentKind::kBox)) {
    Box box;
    box.min = in->get_vector<Eigen::Vector3d>();
    box.max = in->get_vector<Eigen::Vector3d>();
    *extent = box;
  } else if (kind == static_cast<uint8_t>(ExtentKind::kSphere)) {
    Sphere sphere;
    sphere.center = in->get_vector<Eigen::Vector3d>();
    sphere.radius = in->get<double>();
    *extent = sphere;
  }
  return !*extent || check(**extent).has_value();
}

}  // namespace

/// Bits of the last flag: kHasExtents says whether the extents of `wanting_points` follow it.
constexpr uint8_t kIsDue = 1;
constexpr uint8_t kHasExtents = 2;

Blob encode_work(const WorkRecord& work) {
  ByteWriter out;
  out.put(static_cast<uint32_t>(work.wanting_points.size()));
  for (const PendingKeyframe& p : work.wanting_points) {
    out.put(p.id.value);
    out.put(static_cast<uint32_t>(p.next_level));
    out.put(static_cast<uint32_t>(p.next_candidate));
    out.put(static_cast<uint32_t>(p.made));
  }
  put_ids(work.wanting_observers, &out);
  out.put(work.newest.value);
  out.put(static_cast<uint8_t>(work.local_adjustment_due));
  out.put(static_cast<uint8_t>(work.upkeep_due));
  const bool has_extents =
      std::ranges::any_of(work.wanting_points, [](const PendingKeyframe& p) { return p.extent.has_value(); });
  out.put(static_cast<uint8_t>((work.global_adjustment_due ? kIsDue : 0) | (has_extents ? kHasExtents : 0)));
  for (const PendingKeyframe& p : work.wanting_points)
    if (has_extents) put_extent(p.extent, &out);
  return out.take();
}

std::optional<WorkRecord> decode_work(std::span<const uint8_t> row) {
  constexpr size_t kPendingBytes = kIdBytes + 3 * sizeof(uint32_t);
  constexpr uint32_t kMostMade = 1U << 20;
  ByteReader in(row);
  WorkRecord work;
  work.wanting_points.resize(in.get_count(kPendingBytes));
  bool sound = true;
  for (PendingKeyframe& p : work.wanting_points) {
    p.id.value = in.get<uint64_t>();
    p.next_level = in.get<uint32_t>();
    p.next_candidate = in.get<uint32_t>();
    const auto made = in.get<uint32_t>();
    sound = sound && made <= kMostMade;
    p.made = static_cast<int>(made & (kMostMade - 1));
  }
  work.wanting_observers = get_ids<PointId>(&in);
  work.newest.value = in.get<uint64_t>();
  work.local_adjustment_due = in.get<uint8_t>() != 0;
  work.upkeep_due = in.get<uint8_t>() != 0;
  const auto last = in.get<uint8_t>();
  work.global_adjustment_due = (last & kIsDue) != 0;
  const bool has_extents = (last & kHasExtents) != 0;
  for (PendingKeyframe& p : work.wanting_points)
    if (has_extents) sound = sound && get_extent(&in, &p.extent);
  if (!in.finished() || !sound) return std::nullopt;
  return work;
}

// ---- image

Blob encode_image_row(const GrayImage& image) {
  // Huffman codes alone are smaller and faster than matching on filtered camera noise.
  const std::vector<int> options{cv::IMWRITE_PNG_COMPRESSION, 1, cv::IMWRITE_PNG_STRATEGY,
                                 cv::IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY};
  const cv::Mat view(image.height(), image.width(), CV_8UC1, const_cast<uint8_t*>(image.row(0)),
                     static_cast<size_t>(image.stride()));
  Blob bytes;
  cv::imencode(".png", view, bytes, options);
  return bytes;
}

GrayImagePtr decode_image_row(std::span<const uint8_t> row) {
  Result<GrayImage> image = decode_gray_image(row);
  return image ? std::make_shared<const GrayImage>(std::move(*image)) : nullptr;
}

}  // namespace cairn
