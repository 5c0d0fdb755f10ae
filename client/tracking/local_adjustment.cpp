// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <optional>
#include <unordered_map>
#include <vector>

#include "client/tracking/local_map.h"
#include "common/bundle/bundle.h"

namespace cairn {
/// The problem, and which of its poses and points are which.
class LocalMap::Adjustment {
 public:
  Adjustment(LocalMap* map, const CameraPtr& camera) : map_(map), camera_(camera) {
    list_places();
    const std::vector<Keyframe>& keyframes = map->keyframes_;
    size_t moving = 0;
    for (size_t i = keyframes.size(); i-- > 0 && moving < map->options_.moving;) {
      if (keyframes[i].answered || !keyframes[i].has_pose) continue;
      add_view(i, false);
      ++moving;
    }
    for (size_t i = 0; i < keyframes.size(); ++i) {
      const bool is_in = std::find(views_.begin(), views_.end(), i) != views_.end();
      if (!is_in && keyframes[i].has_pose && !keyframes[i].measurements.empty()) add_view(i, true);
    }
    fix_what_is_seen_from_one_side();
    hold_somewhere(moving);
  }

  [[nodiscard]] bool solve() {
    BundleOptions options;
    options.max_iterations = map_->options_.adjustment_iterations;
    return solve_bundle(&problem_, options).usable;
  }

  /// Poses first: what hangs on a keyframe goes with it.
  void write_back() {
    for (size_t v = 0; v < views_.size(); ++v)
      map_->keyframes_[views_[v]].camera_from_map = problem_.poses[v].camera_from_map;
    for (size_t v = 0; v < views_.size(); ++v) {
      Keyframe& k = map_->keyframes_[views_[v]];
      const SE3* reference = problem_.poses[v].fixed ? nullptr : map_->pose_of(k.reference);
      if (reference != nullptr) k.camera_from_reference = k.camera_from_map * reference->inverse();
    }
    for (size_t p = 0; p < places_.size(); ++p) {
      if (problem_.fixed_points[p]) continue;
      const Place& place = places_[p];
      Keyframe& owner = map_->keyframes_[place.keyframe];
      owner.blocks[place.block].positions[place.slot] = owner.camera_from_map * problem_.points[p];
    }
  }

 private:
  struct Place {
    size_t keyframe = 0;
    size_t block = 0;
    size_t slot = 0;
  };

  void list_places() {
    for (size_t k = 0; k < map_->keyframes_.size(); ++k) {
      if (!map_->keyframes_[k].has_pose) continue;
      const std::vector<Block>& blocks = map_->keyframes_[k].blocks;
      for (size_t b = 0; b < blocks.size(); ++b) {
        for (size_t s = 0; s < blocks[b].numbers.size(); ++s) {
          by_number_[blocks[b].numbers[s]] = {k, b, s};
          number_of_[blocks[b].patches->points[s].id.value] = blocks[b].numbers[s];
        }
      }
    }
  }

  void add_view(size_t keyframe, bool is_fixed) {
    const Keyframe& k = map_->keyframes_[keyframe];
    const auto view = static_cast<int>(views_.size());
    views_.push_back(keyframe);
    problem_.poses.push_back({k.camera_from_map, camera_, is_fixed});
    for (const LocalMeasurement& m : k.measurements) {
      const auto point = is_fixed ? known_point(m) : point_of(m);
      if (point) problem_.observations.push_back({view, *point, m.pixel, 1 / m.sigma});
    }
  }

  [[nodiscard]] uint64_t number_of(const LocalMeasurement& m) const {
    if (!m.id) return m.number;
    const auto found = number_of_.find(m.id.value);
    return found == number_of_.end() ? 0 : found->second;
  }
  [[nodiscard]] static bool is_of_server(const LocalMeasurement& m) { return m.id && !is_local(m.id); }

  [[nodiscard]] std::optional<int> known_point(const LocalMeasurement& m) const {
    if (is_of_server(m)) return std::nullopt;
    const auto known = point_of_number_.find(number_of(m));
    return known == point_of_number_.end() ? std::nullopt : std::optional(known->second);
  }

  [[nodiscard]] std::optional<int> point_of(const LocalMeasurement& m) {
    if (is_of_server(m)) {
      const auto slot = map_->base_->find(m.id);
      if (!slot) return std::nullopt;
      return add_point(map_->base_->point_blocks[static_cast<size_t>(slot->block)]->position(slot->slot), {},
                       true);
    }
    if (const auto known = known_point(m)) return known;
    const auto place = by_number_.find(number_of(m));
    if (place == by_number_.end()) return std::nullopt;
    const Keyframe& owner = map_->keyframes_[place->second.keyframe];
    const Block& block = owner.blocks[place->second.block];
    const int point = add_point(owner.camera_from_map.inverse() * block.positions[place->second.slot],
                                place->second, false);
    point_of_number_[number_of(m)] = point;
    return point;
  }

  int add_point(const Eigen::Vector3d& position, const Place& place, bool is_fixed) {
    problem_.points.push_back(position);
    problem_.fixed_points.push_back(is_fixed);
    places_.push_back(place);
    return static_cast<int>(places_.size()) - 1;
  }

  void fix_what_is_seen_from_one_side() {
    std::vector<std::vector<Eigen::Vector3d>> rays(problem_.points.size());
    for (const BundleObservation& o : problem_.observations) {
      const auto p = static_cast<size_t>(o.point);
      if (problem_.fixed_points[p]) continue;
      const SE3& pose = problem_.poses[static_cast<size_t>(o.pose)].camera_from_map;
      rays[p].push_back((problem_.points[p] - pose.center()).normalized());
    }
    const double most_cosine = std::cos(map_->options_.least_parallax);
    for (size_t p = 0; p < rays.size(); ++p) {
      if (problem_.fixed_points[p]) continue;
      bool is_wide = false;
      for (size_t i = 0; i < rays[p].size() && !is_wide; ++i) {
        is_wide = std::any_of(rays[p].begin(), rays[p].begin() + static_cast<ptrdiff_t>(i),
                              [&](const Eigen::Vector3d& ray) { return ray.dot(rays[p][i]) < most_cosine; });
      }
      problem_.fixed_points[p] = !is_wide;
    }
  }

  /// Keeps the problem from floating: where neither an older keyframe nor enough fixed points hold it, the
  /// oldest of the moving keyframes stays.
  void hold_somewhere(size_t moving) {
    const auto held = std::count(problem_.fixed_points.begin(), problem_.fixed_points.end(), true);
    if (moving > 0 && moving == views_.size() && held < map_->options_.fewest_fixed_points)
      problem_.poses[moving - 1].fixed = true;
  }

  LocalMap* map_;
  CameraPtr camera_;
  BundleProblem problem_;
  std::vector<size_t> views_;  ///< keyframe of each pose
  std::vector<Place> places_;  ///< of each point; of the tracker's own only
  std::unordered_map<uint64_t, Place> by_number_;
  std::unordered_map<uint64_t, uint64_t> number_of_;  ///< by id
  std::unordered_map<uint64_t, int> point_of_number_;
};

const SE3* LocalMap::pose_of(KeyframeId id) {
  if (const Keyframe* local = find(id)) return local->has_pose ? &local->camera_from_map : nullptr;
  const KeyframePose* pose = base_->find(id);
  return pose == nullptr ? nullptr : &pose->camera_from_map;
}

std::optional<SE3> LocalMap::adjust(const CameraPtr& camera) {
  if (!base_ || keyframes_.empty()) return std::nullopt;
  aim(*base_);
  Adjustment adjustment(this, camera);
  if (!adjustment.solve()) return std::nullopt;
  adjustment.write_back();
  extended_.reset();
  return keyframes_.back().camera_from_reference;
}

}  // namespace cairn
