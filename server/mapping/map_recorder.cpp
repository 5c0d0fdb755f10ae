// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <bit>

#include "server/mapping/map_record.h"

namespace cairn {
namespace {

constexpr uint64_t kNeverGiven = 0;

/// A 64-bit digest of numbers in their order (multiply and fold; the constant is that of Knuth's
/// multiplicative hashing). Never kNeverGiven.
class Digest {
 public:
  Digest& operator<<(uint64_t word) {
    state_ = (state_ ^ word) * 0x9E3779B97F4A7C15;
    state_ ^= state_ >> 29;
    return *this;
  }
  Digest& operator<<(double value) { return *this << std::bit_cast<uint64_t>(value); }
  Digest& operator<<(const Eigen::Vector3d& v) { return *this << v.x() << v.y() << v.z(); }
  Digest& operator<<(const Eigen::Vector2f& v) {
    return *this << (uint64_t{std::bit_cast<uint32_t>(v.x())} << 32 | std::bit_cast<uint32_t>(v.y()));
  }
  template <typename Tag>
  Digest& operator<<(CounterId<Tag> id) {
    return *this << id.value;
  }
  [[nodiscard]] uint64_t value() const { return state_ | 1; }

 private:
  uint64_t state_ = 0x243F6A8885A308D3;
};

uint64_t digest_of(const MapKeyframe& k) {
  Digest digest;
  const Eigen::Quaterniond& q = k.camera_from_map.rotation();
  digest << k.reference << static_cast<uint64_t>(k.time.nanoseconds) << q.x() << q.y() << q.z() << q.w()
         << k.camera_from_map.translation() << k.mean_depth << k.near_depth << k.far_depth << uint64_t{k.live}
         << static_cast<uint64_t>(k.estimated_camera);
  return digest.value();
}

uint64_t digest_of(const MapCamera& c) {
  Digest digest;
  for (const double value : c.camera->parameters().values) digest << value;
  for (const uint8_t byte : c.version.client.bytes) digest << uint64_t{byte};
  digest << uint64_t{c.version.camera} << uint64_t{c.version.version} << uint64_t{c.frozen}
         << uint64_t{c.judged_keyframes} << static_cast<uint64_t>(c.agreements);
  for (const Intrinsics& i : {c.sigma, c.judged, c.searched}) digest << i[0] << i[1];
  return digest.value();
}

uint64_t measurements_digest(const MapKeyframe& k) {
  Digest digest;
  for (const Measurement& m : k.measurements) digest << m.point << uint64_t{m.level} << m.pixel;
  digest << uint64_t{k.given_up.size()};
  for (const PointId id : k.given_up) digest << id;
  return digest.value();
}

uint64_t digest_of(const PositionsRecord& record) {
  Digest digest;
  for (const PositionsRecord::Point& p : record.points) {
    digest << p.position << static_cast<uint64_t>(p.attempts) << static_cast<uint64_t>(p.found)
           << uint64_t{p.live};
  }
  return digest.value();
}

uint64_t digest_of(const WorkRecord& work) {
  Digest digest;
  for (const PendingKeyframe& p : work.wanting_points) {
    digest << p.id << uint64_t{p.next_level} << uint64_t{p.next_candidate}
           << static_cast<uint64_t>(p.made);  // its extent goes with the id
  }
  digest << uint64_t{work.wanting_observers.size()};
  for (const PointId id : work.wanting_observers) digest << id;
  digest << work.newest << uint64_t{work.local_adjustment_due} << uint64_t{work.upkeep_due}
         << uint64_t{work.global_adjustment_due};
  return digest.value();
}

/// Whether `*given` is not `now`, which it then becomes.
bool renew(uint64_t* given, uint64_t now) {
  return std::exchange(*given, now) != now;
}

KeyframeRecord record_of(const MapKeyframe& k) {
  return {k.id,         k.reference,  k.camera,    k.time, k.camera_from_map,
          k.mean_depth, k.near_depth, k.far_depth, k.live, k.estimated_camera,
          k.still,      k.up,         k.adds_only};
}

PositionsRecord positions_of(const MapState& map, size_t block) {
  PositionsRecord record{static_cast<uint32_t>(block), {}};
  const size_t end = std::min(map.points().size(), (block + 1) * kBlockSlots);
  for (size_t i = block * kBlockSlots; i < end; ++i) {
    const MapPoint& p = map.points()[i];
    record.points.push_back({p.position, p.attempts, p.found, p.live});
  }
  return record;
}

SourcesRecord sources_of(const MapState& map, size_t block) {
  SourcesRecord record{static_cast<uint32_t>(block), {}};
  const size_t end = std::min(map.points().size(), (block + 1) * kBlockSlots);
  for (size_t i = block * kBlockSlots; i < end; ++i)
    record.points.push_back(source_in_block(map.points()[i]));
  return record;
}

}  // namespace

MapRecord MapRecorder::take(const MapState& map, const FoundationRecord& foundation, const WorkRecord& work) {
  MapRecord record;
  record.keyframe_count = map.keyframes().size();
  record.point_count = map.points().size();
  if (!std::exchange(has_foundation_, true)) record.foundation = foundation;
  if (renew(&work_, digest_of(work))) record.work = work;

  cameras_.resize(map.cameras().size(), kNeverGiven);
  for (size_t i = 0; i < cameras_.size(); ++i) {
    const MapCamera& camera = map.cameras()[i];
    if (renew(&cameras_[i], digest_of(camera)))
      record.calibrated_cameras.push_back({static_cast<int>(i), camera});
  }
  keyframes_.resize(record.keyframe_count, kNeverGiven);
  measurements_.resize(record.keyframe_count, kNeverGiven);
  has_image_.resize(record.keyframe_count, false);
  for (size_t i = 0; i < record.keyframe_count; ++i) {
    const MapKeyframe& k = map.keyframes()[i];
    if (renew(&keyframes_[i], digest_of(k))) record.keyframes.push_back(record_of(k));
    if (renew(&measurements_[i], measurements_digest(k)))
      record.measurements.push_back({k.id, k.measurements, k.given_up});
    if (k.live == has_image_[i]) continue;
    has_image_[i] = k.live;
    if (!k.live) {
      record.removed_images.push_back(k.id);
    } else if (k.images != nullptr) {  // one that was evicted has been kept
      record.images.push_back({k.id, GrayImagePtr(k.images, &k.images->pyramid.level(0))});
    }
  }

  // A block of sources is only ever completed, unless patches were aimed for another camera.
  if (std::exchange(aims_, map.aims()) != map.aims()) sources_ = 0;
  const size_t blocks = block_count(record.point_count);
  const size_t first_new = sources_ == record.point_count ? blocks : sources_ / kBlockSlots;
  for (size_t b = first_new; b < blocks; ++b) record.sources.push_back(sources_of(map, b));
  sources_ = record.point_count;
  positions_.resize(blocks, kNeverGiven);
  for (size_t b = 0; b < blocks; ++b) {
    PositionsRecord positions = positions_of(map, b);
    if (renew(&positions_[b], digest_of(positions))) record.positions.push_back(std::move(positions));
  }
  return record;
}

}  // namespace cairn
