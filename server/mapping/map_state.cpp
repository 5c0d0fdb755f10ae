// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/map_state.h"

#include <algorithm>

#include "common/geometry/scene_depth.h"
#include "common/image/patch_border.h"
#include "common/map/limits.h"
#include "server/mapping/patch_view.h"

namespace cairn {
namespace {

bool by_point(const Measurement& m, PointId id) {
  return m.point < id;
}

template <typename Container, typename Id>
void erase_sorted(Container* ids, Id id) {
  const auto it = std::lower_bound(ids->begin(), ids->end(), id);
  if (it != ids->end() && *it == id) ids->erase(it);
}

template <typename Container, typename Id>
void insert_sorted(Container* ids, Id id) {
  const auto it = std::lower_bound(ids->begin(), ids->end(), id);
  if (it == ids->end() || *it != id) ids->insert(it, id);
}

}  // namespace

size_t KeyframeImages::bytes() const {
  size_t total = sizeof(*this);
  for (int l = 0; l < kPyramidLevels; ++l) {
    const auto i = static_cast<size_t>(l);
    total += static_cast<size_t>(pyramid.level(l).stride()) * static_cast<size_t>(pyramid.level(l).height());
    total +=
        corners[i].corners.capacity() * sizeof(Corner) + corners[i].row_begin.capacity() * sizeof(uint32_t);
  }
  return total;
}

size_t expected_image_bytes(const Camera& camera) {
  return static_cast<size_t>(camera.width()) * static_cast<size_t>(camera.height()) * 5 / 3;
}

std::shared_ptr<const KeyframeImages> prepare_images(const GrayView& image, const StillMaskPtr& still) {
  auto images = std::make_shared<KeyframeImages>();
  images->pyramid.build(image);
  images->corners = detect_corners(images->pyramid);
  for (int l = 0; l < kPyramidLevels; ++l) {
    const auto i = static_cast<size_t>(l);
    if (still) still->remove_covered_from(&images->corners[i], l);
    images->corners[i].corners.shrink_to_fit();
  }
  return images;
}

std::vector<Candidate> point_candidates(const KeyframeImages& images, int level,
                                        const TwoViewPointOptions& options) {
  return find_candidates(images.level(level), images.corners[static_cast<size_t>(level)],
                         options.corner_barrier, kPatchBorder, options.corner_texture);
}

PointSource source_in_block(const MapPoint& point) {
  if (point.source) return *point.source;
  PointSource removed;
  removed.id = point.id;
  removed.keyframe = KeyframeId{1};
  return removed;
}

MapState::MapState(std::vector<MapKeyframe> keyframes, std::vector<MapPoint> points,
                   std::vector<MapCamera> cameras)
    : cameras_(std::move(cameras)), keyframes_(std::move(keyframes)), points_(std::move(points)) {
  for (MapPoint& p : points_) {
    p.observers.clear();
    if (p.live) live_points_.push_back(p.id);
  }
  for (const MapKeyframe& k : keyframes_) {
    for (const Measurement& m : k.measurements) point(m.point).observers.push_back(k.id);
  }
}

size_t MapState::live_keyframes() const {
  return static_cast<size_t>(
      std::count_if(keyframes_.begin(), keyframes_.end(), [](const MapKeyframe& k) { return k.live; }));
}

int MapState::camera_index(const CameraPrior& prior) const {
  const auto known = std::find_if(cameras_.begin(), cameras_.end(), [&](const MapCamera& c) {
    return c.version.client == prior.version.client && c.version.camera == prior.version.camera;
  });
  return known == cameras_.end() ? -1 : static_cast<int>(known - cameras_.begin());
}

size_t MapState::free_place() const {
  if (cameras_.size() < kMaxCalibratedCameras) return cameras_.size();
  std::vector<size_t> loss;
  for (size_t i = 0; i < cameras_.size(); ++i)
    loss.push_back(cameras_[i].frozen ? 0 : keyframes_of(static_cast<int>(i)).live);
  return static_cast<size_t>(std::min_element(loss.begin(), loss.end()) - loss.begin());
}

int MapState::add_camera(const CameraPtr& camera, const CameraPrior& prior) {
  const size_t place = free_place();
  const int index = static_cast<int>(place);
  if (place == cameras_.size()) {
    cameras_.push_back(make_map_camera(camera, prior));
    return index;
  }
  for (MapKeyframe& k : keyframes_) {
    if (k.estimated_camera == index) k.estimated_camera = -1;
  }
  cameras_[place] = make_map_camera(camera, prior);
  return index;
}

bool MapState::has_known_camera(const MapKeyframe& keyframe) const {
  return keyframe.estimated_camera < 0 || cameras_[static_cast<size_t>(keyframe.estimated_camera)].frozen;
}

KeyframeCount MapState::keyframes_of(int camera) const {
  KeyframeCount count;
  for (const MapKeyframe& k : keyframes_) {
    if (k.estimated_camera != camera) continue;
    ++count.made;
    count.live += k.live ? 1 : 0;
  }
  return count;
}

void MapState::update_camera(const CutCamera& cut, const FreeCamera& adjusted,
                             const SelfCalibrationOptions& options) {
  MapCamera& camera = cameras_[static_cast<size_t>(cut.index)];
  if (camera.version.client != cut.version.client || camera.version.camera != cut.version.camera) return;
  update(&camera, adjusted, cut.keyframes, options);
  for (MapKeyframe& k : keyframes_) {
    if (k.estimated_camera == cut.index) k.camera = camera.camera;
  }
}

bool MapState::follow_cameras(const SelfCalibrationOptions& options) {
  std::vector<bool> moved(cameras_.size(), false);
  bool felt = false;
  for (size_t i = 0; i < cameras_.size(); ++i) {
    const CameraMove move = take_move(&cameras_[i], options);
    moved[i] = move != CameraMove::kNone;
    felt |= move == CameraMove::kFelt;
  }
  if (std::find(moved.begin(), moved.end(), true) != moved.end()) aim_patches(moved);
  if (!felt) return false;
  for (MapKeyframe& k : keyframes_) k.given_up.clear();
  return true;
}

void MapState::aim_patches(const std::vector<bool>& chosen) {
  ++aims_;
  for (MapPoint& p : points_) {
    if (!p.live) continue;
    const MapKeyframe& source = keyframe(p.source->keyframe);
    if (source.estimated_camera < 0 || !chosen[static_cast<size_t>(source.estimated_camera)]) continue;
    PointSource aimed = *p.source;
    aim_source(*source.camera, &aimed);
    p.source = std::make_shared<const PointSource>(aimed);
  }
}

void MapState::publish_cameras(const MapMakerOptions& options) {
  for (MapCamera& c : cameras_) publish(&c, options.self_calibration, options.publication);
}

void MapState::take_cameras_as_published(const SelfCalibrationOptions& options) {
  for (MapCamera& c : cameras_) count_as_published(&c, options);
}

KeyframeId MapState::add_keyframe(MapKeyframe keyframe) {
  keyframe.id = KeyframeId{keyframes_.size() + 1};
  keyframes_.push_back(std::move(keyframe));
  return keyframes_.back().id;
}

PointId MapState::add_point(const PointSource& source, const Eigen::Vector3d& position) {
  MapPoint& point = points_.emplace_back();
  point.id = PointId{points_.size()};
  PointSource named = source;
  named.id = point.id;
  point.source = std::make_shared<const PointSource>(named);
  point.position = position;
  live_points_.push_back(point.id);
  return point.id;
}

void MapState::add_measurement(KeyframeId keyframe_id, const Measurement& measurement) {
  std::vector<Measurement>& all = keyframe(keyframe_id).measurements;
  const auto it = std::lower_bound(all.begin(), all.end(), measurement.point, by_point);
  if (it != all.end() && it->point == measurement.point) {
    *it = measurement;
  } else {
    all.insert(it, measurement);
  }
  insert_sorted(&point(measurement.point).observers, keyframe_id);
}

void MapState::drop_measurement(KeyframeId keyframe_id, PointId point_id) {
  std::vector<Measurement>& all = keyframe(keyframe_id).measurements;
  const auto it = std::lower_bound(all.begin(), all.end(), point_id, by_point);
  if (it == all.end() || it->point != point_id) return;
  all.erase(it);
  give_up(keyframe_id, point_id);
  MapPoint& p = point(point_id);
  std::erase(p.observers, keyframe_id);
  if (p.observers.size() < 2 || p.source->keyframe == keyframe_id) remove_point(point_id);
}

void MapState::give_up(KeyframeId keyframe_id, PointId point_id) {
  insert_sorted(&keyframe(keyframe_id).given_up, point_id);
}

void MapState::share_sources(const std::shared_ptr<const PatchBlock>& block) {
  for (const PointSource& published : block->points) {
    MapPoint& p = point(published.id);
    if (p.source && p.source.get() != &published)
      p.source = std::shared_ptr<const PointSource>(block, &published);
  }
}

void MapState::remove_point(PointId id) {
  MapPoint& p = point(id);
  if (!p.live) return;
  p.live = false;
  p.position.setZero();  // what it was removed for may be that it was nowhere: nobody is to keep that
  for (const KeyframeId observer : p.observers) {
    std::vector<Measurement>& all = keyframe(observer).measurements;
    const auto it = std::lower_bound(all.begin(), all.end(), id, by_point);
    if (it != all.end() && it->point == id) all.erase(it);
  }
  p.observers = {};
  p.source = nullptr;
  for (MapKeyframe& k : keyframes_) erase_sorted(&k.given_up, id);
  erase_sorted(&live_points_, id);
}

void MapState::remove_keyframe(KeyframeId id) {
  MapKeyframe& k = keyframe(id);
  if (!k.live) return;
  for (const Measurement& m : std::vector<Measurement>(k.measurements)) drop_measurement(id, m.point);
  k.measurements = {};
  k.given_up = {};
  k.images = nullptr;
  k.live = false;
}

const Measurement* MapState::find_measurement(KeyframeId keyframe_id, PointId point_id) const {
  const std::vector<Measurement>& all = keyframe(keyframe_id).measurements;
  const auto it = std::lower_bound(all.begin(), all.end(), point_id, by_point);
  return it != all.end() && it->point == point_id ? &*it : nullptr;
}

bool MapState::has_given_up(KeyframeId keyframe_id, PointId point_id) const {
  const std::vector<PointId>& all = keyframe(keyframe_id).given_up;
  return std::binary_search(all.begin(), all.end(), point_id);
}

void MapState::update_depths(KeyframeId id) {
  MapKeyframe& k = keyframe(id);
  std::vector<double> depths;
  depths.reserve(k.measurements.size());
  for (const Measurement& m : k.measurements) {
    const double z = (k.camera_from_map * point(m.point).position).z();
    if (z > 0) depths.push_back(z);
  }
  if (depths.empty()) return;
  k.mean_depth = scene_depth(&depths);
  std::sort(depths.begin(), depths.end());
  k.near_depth = depths[depths.size() / 20];
  k.far_depth = depths[depths.size() - 1 - depths.size() / 20];
}

std::vector<int> MapState::shared_points(const std::vector<Measurement>& measurements) const {
  std::vector<int> shared(keyframes_.size(), 0);
  for (const Measurement& m : measurements) {
    for (const KeyframeId observer : point(m.point).observers) ++shared[observer.value - 1];
  }
  return shared;
}

void MapState::transform(const Similarity3& new_from_old) {
  for (MapKeyframe& k : keyframes_) {
    k.camera_from_map = new_from_old.transform_camera(k.camera_from_map);
    k.mean_depth *= new_from_old.scale();
    k.near_depth *= new_from_old.scale();
    k.far_depth *= new_from_old.scale();
  }
  for (MapPoint& p : points_) p.position = new_from_old * p.position;
}

}  // namespace cairn
