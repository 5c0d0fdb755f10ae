// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "common/geometry/camera_guess.h"
#include "common/map/limits.h"
#include "server/mapping/map_record.h"

namespace cairn {
namespace {

constexpr size_t kMinKeyframes = 2;  // by definition: a map begins with two views

/// Puts a map together; a step for each kind of record, in the order of what refers to what.
class Assembly {
 public:
  Assembly(const MapRecord& record, RestoredImages images)
      : record_(record), images_(images), keyframes_(record.keyframe_count), points_(record.point_count) {
    for (size_t i = 0; i < keyframes_.size(); ++i) {
      keyframes_[i].id = KeyframeId{i + 1};
      keyframes_[i].live = false;
    }
    for (size_t i = 0; i < points_.size(); ++i) {
      points_[i].id = PointId{i + 1};
      points_[i].live = false;
    }
    has_measurements_.resize(keyframes_.size());
    has_image_.resize(keyframes_.size());
  }

  Result<AssembledMap> run() {
    if (!record_.foundation) return fail(ErrorCode::kDamaged, "what its start has fixed is missing");
    place_cameras();
    place_keyframes();
    if (!stand_in_for_lost_keyframes()) return fail(ErrorCode::kDamaged, "all of its keyframes are lost");
    place_images();
    place_points();
    place_measurements();
    MapState state(std::move(keyframes_), std::move(points_), std::move(cameras_));
    remove_what_lacks_its_parts(&state);
    if (!state.is_live(KeyframeId{1})) return fail(ErrorCode::kDamaged, "its first keyframe is lost");
    if (state.live_keyframes() < kMinKeyframes) {
      return fail(ErrorCode::kDamaged, "fewer than two of its keyframes are left");
    }
    return AssembledMap{std::move(state), std::move(repairs_)};
  }

 private:
  [[nodiscard]] bool is_keyframe(KeyframeId id) const { return id && id.value <= keyframes_.size(); }
  [[nodiscard]] bool is_point(PointId id) const { return id && id.value <= points_.size(); }
  MapKeyframe& keyframe(KeyframeId id) { return keyframes_[id.value - 1]; }

  /// One whose entry is lost keeps its place, and what its keyframes know of it is all that will be known.
  void place_cameras() {
    const auto place = [this](int index, const MapCamera& camera) {
      const auto i = static_cast<size_t>(index);
      if (index < 0 || i >= kMaxCalibratedCameras || camera.camera == nullptr) return;
      if (i >= cameras_.size()) cameras_.resize(i + 1);
      if (cameras_[i].camera == nullptr) cameras_[i] = camera;
    };
    for (const CalibratedCameraRecord& r : record_.calibrated_cameras) place(r.index, r.camera);
    for (const KeyframeRecord& r : record_.keyframes) {
      if (r.camera != nullptr) place(r.estimated_camera, known_camera(r.camera));
    }
    for (MapCamera& c : cameras_) {
      if (c.camera == nullptr) c = known_camera(cameras_.back().camera);  // no keyframe has it
    }
  }
  static MapCamera known_camera(const CameraPtr& camera) {
    MapCamera known;
    known.camera = camera;
    known.searched = known.prior_mean = intrinsics_of(*camera);
    known.sigma = known.prior_sigma =
        Intrinsics::Constant(kLeastPriorSigma);  // not 0: it is written and read again
    known.frozen = true;
    return known;
  }

  void place_keyframes() {
    for (const KeyframeRecord& r : record_.keyframes) {
      if (!is_keyframe(r.id) || r.reference >= r.id || r.camera == nullptr || !r.camera_from_map.is_finite())
        continue;
      MapKeyframe& k = keyframe(r.id);
      k.reference = r.reference;
      k.camera = r.camera;
      k.time = r.time;
      k.camera_from_map = r.camera_from_map;
      k.mean_depth = r.mean_depth;
      k.near_depth = r.near_depth;
      k.far_depth = r.far_depth;
      k.live = r.live;
      k.still = r.still;
      k.up = r.up;
      k.adds_only = r.adds_only;
      if (r.estimated_camera < 0 || static_cast<size_t>(r.estimated_camera) >= cameras_.size()) continue;
      k.estimated_camera = r.estimated_camera;
      k.camera = cameras_[static_cast<size_t>(r.estimated_camera)].camera;
    }
  }

  /// A keyframe whose entry is lost keeps its place like any that was removed, and like these has a camera
  /// and a reference: some. False when there is no camera at all.
  bool stand_in_for_lost_keyframes() {
    const auto has_camera = [](const MapKeyframe& k) { return k.camera != nullptr; };
    const auto sound = std::find_if(keyframes_.begin(), keyframes_.end(), has_camera);
    if (sound == keyframes_.end()) return false;
    for (MapKeyframe& k : keyframes_) {
      if (k.camera != nullptr) continue;
      note_lost(k.id, "its entry");
      k.camera = sound->camera;
      if (k.id > KeyframeId{1}) k.reference = KeyframeId{1};
    }
    return true;
  }

  void place_images() {
    for (const ImageRecord& r : record_.images) {
      if (!is_keyframe(r.keyframe) || !keyframe(r.keyframe).live || r.image == nullptr) continue;
      MapKeyframe& k = keyframe(r.keyframe);
      if (r.image->width() != k.camera->width() || r.image->height() != k.camera->height()) continue;
      has_image_[k.id.value - 1] = true;
      if (images_ == RestoredImages::kStay) k.images = prepare_images(r.image->view(), k.still);
    }
    for (const MapKeyframe& k : keyframes_) {
      if (k.live && !has_image_[k.id.value - 1]) note_lost(k.id, "its image");
    }
  }

  void place_points() {
    for (const SourcesRecord& r : record_.sources) {
      for (size_t s = 0; s < r.points.size(); ++s) {
        const size_t i = size_t{r.block} * kBlockSlots + s;
        if (i >= points_.size() || !is_keyframe(r.points[s].keyframe)) continue;
        PointSource source = r.points[s];
        source.id = points_[i].id;
        points_[i].source = std::make_shared<const PointSource>(source);
      }
    }
    std::vector<bool> has_position(points_.size());
    for (const PositionsRecord& r : record_.positions) {
      for (size_t s = 0; s < r.points.size(); ++s) {
        const size_t i = size_t{r.block} * kBlockSlots + s;
        const PositionsRecord::Point& p = r.points[s];
        if (i >= points_.size() || !p.position.allFinite()) continue;
        has_position[i] = true;
        points_[i].position = p.position;
        points_[i].attempts = p.attempts;
        points_[i].found = p.found;
        points_[i].live = p.live && points_[i].source;
      }
    }
    size_t lost = 0;
    for (size_t i = 0; i < points_.size(); ++i) {
      lost += points_[i].source && has_position[i] ? 0 : 1;
      if (!points_[i].live) points_[i].source = nullptr;
    }
    if (lost > 0) repairs_.push_back(std::to_string(lost) + " points are left out: their entries are lost");
  }

  void place_measurements() {
    size_t dangling = 0;
    for (const MeasurementsRecord& r : record_.measurements) {
      if (!is_keyframe(r.keyframe)) continue;
      has_measurements_[r.keyframe.value - 1] = true;
      MapKeyframe& k = keyframe(r.keyframe);
      if (!k.live) continue;
      PointId last;
      for (const Measurement& m : r.measurements) {
        const bool sound = is_point(m.point) && m.point > last && points_[m.point.value - 1].live &&
                           m.level < kPyramidLevels && m.pixel.allFinite();
        dangling += sound ? 0 : 1;
        if (!sound) continue;
        last = m.point;
        k.measurements.push_back(m);
      }
      for (const PointId id : r.given_up) {
        if (is_point(id) && points_[id.value - 1].live) k.given_up.push_back(id);
      }
      std::sort(k.given_up.begin(), k.given_up.end());
    }
    if (dangling > 0)
      repairs_.push_back(std::to_string(dangling) + " measurements are left out: their points are lost");
    for (const MapKeyframe& k : keyframes_) {
      if (k.live && !has_measurements_[k.id.value - 1]) note_lost(k.id, "its measurements");
    }
  }

  void note_lost(KeyframeId id, const std::string& what) {
    lost_.push_back(id);
    repairs_.push_back("keyframe " + std::to_string(id.value) + " is left out: " + what +
                       (what.back() == 's' ? " are lost" : " is lost"));
  }

  void remove_what_lacks_its_parts(MapState* state) {
    for (const KeyframeId id : lost_) state->remove_keyframe(id);
    if (repairs_.empty()) return;
    const std::vector<PointId> live = state->live_point_ids();
    for (const PointId id : live) {
      const MapPoint& p = state->point(id);
      if (p.observers.size() < 2 || !state->find_measurement(p.source->keyframe, id)) state->remove_point(id);
    }
  }

  const MapRecord& record_;
  const RestoredImages images_;
  std::vector<MapCamera> cameras_;
  std::vector<MapKeyframe> keyframes_;
  std::vector<MapPoint> points_;
  std::vector<bool> has_measurements_;
  std::vector<bool> has_image_;
  std::vector<KeyframeId> lost_;
  std::vector<std::string> repairs_;
};

}  // namespace

Result<AssembledMap> assemble_map(const MapRecord& record, RestoredImages images) {
  return Assembly(record, images).run();
}

}  // namespace cairn
