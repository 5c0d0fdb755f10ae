// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/posed_map.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <utility>

#include "common/geometry/triangulation.h"
#include "common/image/place.h"
#include "server/mapping/map_record.h"
#include "server/mapping/patch_view.h"

namespace cairn {
namespace {

constexpr double kSameSide = 0.5;      // cosine between optical axes: 60 degrees
constexpr int kFarthest = 70;          // of 256: descriptors of one corner seen from two sides
constexpr double kClearly = 0.8;       // nearest over second nearest (Lowe, IJCV 2004)
constexpr double kMaxResidual = 3.0;   // [px of the corner's level] given poses are good to a pixel or two
constexpr double kMinParallax = 0.02;  // [rad]
constexpr double kSpacing = 0.1;       // KeyframeSpacing; no keyframes follow
constexpr double kMinDepths = 5;       // points of a keyframe to know its depths by

struct Still {
  MapKeyframe keyframe;
  std::vector<PlaceCorner> corners;
  std::vector<Descriptor> descriptors;  // of `corners`
  std::vector<PointId> points;          // of `corners`; none where no point was made
};

Still prepare(const CameraPtr& camera, const PosedStill& posed, KeyframeId id) {
  Still still;
  MapKeyframe& k = still.keyframe;
  k.id = id;
  if (id > KeyframeId{1}) k.reference = KeyframeId{1};
  k.camera = camera;
  k.time = posed.time;
  k.camera_from_map = posed.camera_from_world;
  k.images = prepare_images(posed.image->view(), k.still);
  still.corners = describe_place(k.images->pyramid, k.images->corners).corners;
  for (const PlaceCorner& c : still.corners) still.descriptors.push_back(c.descriptor);
  still.points.resize(still.corners.size());
  return still;
}

/// For each corner, the index of that corner of the other still that is clearly most like it; -1: none.
std::vector<int> nearest_in(const Still& a, const Still& b) {
  std::vector<int> nearest;
  nearest.reserve(a.corners.size());
  for (const Descriptor& d : a.descriptors) {
    const NearestDescriptor n = find_nearest(d, b.descriptors);
    const bool is_clear = n.distance <= kFarthest && n.distance < kClearly * n.second_distance;
    nearest.push_back(is_clear ? n.index : -1);
  }
  return nearest;
}

bool projects_near(const MapKeyframe& keyframe, const PlaceCorner& corner, const Eigen::Vector3d& point) {
  const auto pixel = keyframe.camera->project(keyframe.camera_from_map * point);
  return pixel && (*pixel - corner.pixel.cast<double>()).norm() <= kMaxResidual * (1 << corner.level);
}

/// The first points, and what measures them.
class FirstPoints {
 public:
  explicit FirstPoints(std::vector<Still> stills) : stills_(std::move(stills)), measured_(stills_.size()) {
    for (size_t i = 0; i < stills_.size(); ++i) {
      for (size_t j = i + 1; j < stills_.size(); ++j) join(i, j);
    }
    for (size_t i = 0; i < stills_.size(); ++i) set_depths(i);
  }

  /// Every still wants points of its own.
  [[nodiscard]] MapRecord record(const std::vector<PosedStill>& posed) const;

 private:
  using Match = std::pair<size_t, size_t>;  // corners

  void join(size_t i, size_t j) {
    const SE3& a = stills_[i].keyframe.camera_from_map;
    const SE3& b = stills_[j].keyframe.camera_from_map;
    if (a.rotation_matrix().row(2).dot(b.rotation_matrix().row(2)) < kSameSide) return;
    const std::vector<int> there = nearest_in(stills_[i], stills_[j]);
    const std::vector<int> back = nearest_in(stills_[j], stills_[i]);
    for (size_t c = 0; c < there.size(); ++c) {
      const auto d = static_cast<size_t>(there[c]);
      if (there[c] >= 0 && back[d] == static_cast<int>(c)) match(i, c, j, d);
    }
  }

  void match(size_t i, size_t c, size_t j, size_t d) {
    const PointId a = stills_[i].points[c];
    const PointId b = stills_[j].points[d];
    if (a && !b) {
      measure(j, d, a);
    } else if (b && !a) {
      measure(i, c, b);
    } else if (!a && !b) {
      make(i, c, j, d);
    }
  }

  void measure(size_t i, size_t c, PointId point) {
    Still& still = stills_[i];
    const PlaceCorner& corner = still.corners[c];
    if (measured_[i].contains(point) || !projects_near(still.keyframe, corner, position(point))) return;
    still.points[c] = point;
    measured_[i][point] = {point, corner.level, corner.pixel};
  }

  void make(size_t i, size_t c, size_t j, size_t d) {
    const MapKeyframe& a = stills_[i].keyframe;
    const MapKeyframe& b = stills_[j].keyframe;
    const PlaceCorner& from = stills_[i].corners[c];
    const PlaceCorner& to = stills_[j].corners[d];
    const auto in_a = triangulate(b.camera_from_map * a.camera_from_map.inverse(),
                                  a.camera->unproject(from.pixel.cast<double>()),
                                  b.camera->unproject(to.pixel.cast<double>()));
    if (!in_a) return;
    const Eigen::Vector3d point = a.camera_from_map.inverse() * *in_a;
    if (parallax(point, a.camera_from_map.center(), b.camera_from_map.center()) < kMinParallax) return;
    if (!projects_near(a, from, point) || !projects_near(b, to, point)) return;
    const Corner at{static_cast<int16_t>(std::lround(to_level(from.pixel.x(), from.level))),
                    static_cast<int16_t>(std::lround(to_level(from.pixel.y(), from.level)))};
    const auto source = make_source(a, from.level, at);
    if (!source) return;
    sources_.push_back(*source);
    positions_.push_back(point);
    const PointId id{sources_.size()};
    measure(i, c, id);
    measure(j, d, id);
  }

  void set_depths(size_t i) {
    MapKeyframe& k = stills_[i].keyframe;
    std::vector<double> depths;
    for (const auto& [id, _] : measured_[i]) depths.push_back((k.camera_from_map * position(id)).z());
    if (static_cast<double>(depths.size()) < kMinDepths) return;
    std::sort(depths.begin(), depths.end());
    const auto at = [&](double share) {
      return depths[static_cast<size_t>(share * static_cast<double>(depths.size() - 1))];
    };
    k.mean_depth = at(0.5);
    k.near_depth = at(0.05);
    k.far_depth = at(0.95);
  }

  [[nodiscard]] const Eigen::Vector3d& position(PointId id) const { return positions_[id.value - 1]; }

  std::vector<Still> stills_;
  std::vector<std::map<PointId, Measurement>> measured_;  // by still
  std::vector<PointSource> sources_;                      // by id - 1
  std::vector<Eigen::Vector3d> positions_;                // map frame
};

MapRecord FirstPoints::record(const std::vector<PosedStill>& posed) const {
  MapRecord record;
  record.keyframe_count = stills_.size();
  record.point_count = sources_.size();
  FoundationRecord& foundation = record.foundation.emplace();
  foundation.min_distance_over_depth = kSpacing;
  WorkRecord& work = record.work.emplace();
  for (size_t i = 0; i < stills_.size(); ++i) {
    const MapKeyframe& k = stills_[i].keyframe;
    record.keyframes.push_back({k.id, k.reference, k.camera, k.time, k.camera_from_map, k.mean_depth,
                                k.near_depth, k.far_depth, true});
    MeasurementsRecord& measurements = record.measurements.emplace_back();
    measurements.keyframe = k.id;
    for (const auto& [_, m] : measured_[i]) measurements.measurements.push_back(m);
    record.images.push_back({k.id, posed[i].image});
    work.wanting_points.push_back({k.id});
    work.newest = k.id;
  }
  work.local_adjustment_due = work.upkeep_due = work.global_adjustment_due = true;
  for (size_t i = 0; i < sources_.size(); ++i) {
    if (i % kBlockSlots == 0) {
      const auto block = static_cast<uint32_t>(i / kBlockSlots);
      record.sources.push_back({block, {}});
      record.positions.push_back({block, {}});
    }
    record.sources.back().points.push_back(sources_[i]);
    record.positions.back().points.push_back({positions_[i]});
  }
  return record;
}

}  // namespace

Result<PosedMap> map_posed_stills(const CameraPtr& camera, const std::vector<PosedStill>& stills, MapId map,
                                  uint64_t seed) {
  if (stills.size() < 2) return fail(ErrorCode::kDegenerate, "fewer than two stills");
  std::vector<Still> prepared;
  prepared.reserve(stills.size());
  for (size_t i = 0; i < stills.size(); ++i)
    prepared.push_back(prepare(camera, stills[i], KeyframeId{i + 1}));
  MapMakerOptions options;
  options.seed = seed;
  auto restored = MapMaker::restore(FirstPoints(std::move(prepared)).record(stills),
                                    {map, "posed stills", Epoch{1}}, options);
  if (!restored) return fail(ErrorCode::kDegenerate, restored.error().message);
  MappingObserver silent;
  finish_work(restored->maker.get(), false, &silent);
  const MapSnapshotPtr snapshot = restored->maker->snapshot();
  PosedMap result;
  for (size_t i = 0; i < stills.size(); ++i) {
    if (const KeyframePose* k = snapshot->find(KeyframeId{i + 1}))
      result.poses.push_back({stills[i].time, k->camera_from_map.inverse()});
  }
  result.map = index_map(nullptr, snapshot, restored->maker->keyframe_views(), GravityOptions());
  result.record = restored->maker->take_changes();
  return result;
}

}  // namespace cairn
