// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/exact_map.h"

#include <algorithm>
#include <set>

#include "common/image/corners.h"

namespace cairn::testing {
namespace {

constexpr size_t kPointsPerLevel = 200;

}  // namespace

PlaceView describe_image(const GrayView& image) {
  Pyramid pyramid;
  pyramid.build(image);
  return describe_place(pyramid, detect_corners(pyramid));
}

SE3 pose_at(int step, double advance) {
  return SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, -advance)) * Scene::pose(step);
}

ExactMap::ExactMap(uint8_t id, const std::vector<MappedScene>& scenes) {
  auto keyframes = std::make_shared<KeyframeBlock>();
  for (const MappedScene& mapped : scenes)
    for (const int step : mapped.steps) add_keyframe(mapped, step, keyframes.get());
  auto snapshot = std::make_shared<MapSnapshot>();
  snapshot->map.bytes[0] = id;
  snapshot->epoch = Epoch{3};
  snapshot->revision = Revision{7};
  snapshot->keyframe_blocks = {keyframes};
  for (size_t first = 0; first < sources_.size(); first += kBlockSlots) {
    const size_t last = std::min(sources_.size(), first + kBlockSlots);
    const auto begin = static_cast<ptrdiff_t>(first);
    const auto end = static_cast<ptrdiff_t>(last);
    auto patches = std::make_shared<PatchBlock>();
    patches->points.assign(sources_.begin() + begin, sources_.begin() + end);
    auto positions = std::make_shared<PositionBlock>();
    positions->positions.assign(positions_.begin() + begin, positions_.begin() + end);
    positions->visibility.resize(last - first);
    positions->live = last - first == kBlockSlots ? ~uint64_t{0} : (uint64_t{1} << (last - first)) - 1;
    snapshot->point_blocks.push_back(make_point_block(patches, positions, snapshot->keyframe_blocks));
  }
  snapshot_ = snapshot;
}

void ExactMap::add_keyframe(const MappedScene& mapped, int step, KeyframeBlock* keyframes) {
  const KeyframeId id{views_.size() + 1};
  const SE3 pose = pose_at(step, mapped.advance);
  const Eigen::Vector3d aside(mapped.aside, 0, 0);
  const SE3 camera_from_map = pose * SE3(Eigen::Quaterniond::Identity(), -aside);
  auto pyramid = std::make_shared<Pyramid>();
  pyramid->build(mapped.scene->render(pose, static_cast<uint64_t>(step))->view());
  KeyframeView view{id, mapped.scene->camera(), pyramid, {}};
  if (mapped.shares) share_points(*mapped.scene, camera_from_map, &view);
  const size_t shared = view.measurements.size();
  const auto corners = detect_corners(*pyramid);
  double depth_sum = 0;
  for (int l = 0; l < kPyramidLevels; ++l) {
    auto candidates = find_candidates(pyramid->level(l), corners[static_cast<size_t>(l)], 6, 14, 20);
    std::stable_sort(candidates.begin(), candidates.end(),
                     [](const auto& a, const auto& b) { return a.score > b.score; });
    candidates.resize(std::min(candidates.size(), kPointsPerLevel));
    for (const Candidate& c : candidates) {
      const Eigen::Vector2f pixel(from_level(c.corner.x, l), from_level(c.corner.y, l));
      const Eigen::Vector3d point = mapped.scene->hit(pose, pixel.cast<double>());
      PointSource source;
      source.id = PointId{sources_.size() + 1};
      source.keyframe = id;
      sources_.push_back(source);
      positions_.push_back((point + aside).cast<float>());
      view.measurements.push_back({source.id, static_cast<uint8_t>(l), pixel});
      depth_sum += (pose * point).z();
    }
  }
  const auto depth = static_cast<float>(depth_sum / static_cast<double>(view.measurements.size() - shared));
  keyframes->live |= uint64_t{1} << keyframes->keyframes.size();
  keyframes->keyframes.push_back({id, camera_from_map, depth});
  views_.push_back(std::move(view));
}

void ExactMap::share_points(const Scene& scene, const SE3& camera_from_map, KeyframeView* view) const {
  constexpr size_t kMost = 20;  // of a keyframe
  constexpr double kBorder = 40;
  std::set<PointId> measured;
  for (const KeyframeView& other : views_) {
    for (size_t i = 0; i < std::min(kMost, other.measurements.size()); ++i) {
      const PointMeasurement& m = other.measurements[i];
      const Eigen::Vector3d point = positions_[m.id.value - 1].cast<double>();
      const auto pixel = scene.camera()->project(camera_from_map * point);
      if (pixel && scene.camera()->in_image(*pixel, kBorder) && measured.insert(m.id).second)
        view->measurements.push_back({m.id, m.level, pixel->cast<float>()});
    }
  }
}

std::vector<PlaceMatch> match_all(const PlaceView& view, const IndexedMap& map, size_t keyframe) {
  const auto cells = probed_cells(view);
  const MatchOptions options;
  return match_closer(view, cells, map, keyframe, run_prefilter(view, cells, map, keyframe, options),
                      options);
}

SE3 camera_of(const RelocalizationAnswer& answer, const MapSnapshot& map) {
  const PlaceCandidate& best = answer.candidates.front();
  return best.camera_from_keyframe * map.find(best.keyframe)->camera_from_map;
}

double error_of(const SE3& estimate, const SE3& truth, const MapSnapshot& map) {
  return (estimate.center() - truth.center()).norm() / map.nearest_keyframe(truth.center())->mean_depth;
}

}  // namespace cairn::testing
