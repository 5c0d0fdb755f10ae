// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/provisional_points.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "common/image/patch_border.h"
#include "common/image/smear.h"

namespace cairn {

ProvisionalPoints::ProvisionalPoints(CameraPtr camera, const ProvisionalPointsOptions& options,
                                     const PoseJudgementOptions& judgement)
    : camera_(std::move(camera)), options_(options), judgement_(judgement) {
  points_.reserve(kMostPoints);
  observations_.reserve(kMostPoints);
  estimate_.weights.reserve(kMostPoints);
  workspace_.linearized.reserve(kMostPoints);
  workspace_.squared.reserve(kMostPoints);
  clear();
}

void ProvisionalPoints::use_camera(CameraPtr camera) {
  camera_ = std::move(camera);
  clear();
}

void ProvisionalPoints::clear() {
  points_.clear();
  observations_.clear();
  for (Anchor& anchor : anchors_) anchor.points = 0;
  map_.reset();
  frames_unbegun_ = options_.begin_every;
}

ProvisionalPoints::Followed ProvisionalPoints::at(size_t i) const {
  const Point& p = points_[i];
  return {p.id,        anchors_[p.anchor].anchor_from_map,
          p.bearing,   p.inverse_depth,
          p.variance,  p.pixel,
          p.level,     p.found,
          p.innovation};
}

void ProvisionalPoints::known(std::vector<LocalPoint>* out) const {
  for (const Point& p : points_) {
    if (!p.found || p.refused > 0 ||
        p.variance > options_.point_depth * options_.point_depth * p.inverse_depth * p.inverse_depth)
      continue;
    const SE3 map_from_anchor = anchors_[p.anchor].anchor_from_map.inverse();
    const double distance = 1 / p.inverse_depth;
    LocalPoint& point = out->emplace_back();
    point.number = p.id.value;
    point.level = p.level;
    point.position = map_from_anchor * (distance * p.bearing);
    point.seen_from = map_from_anchor.translation();
    point.right = map_from_anchor.rotation() * (distance * p.right);
    point.down = map_from_anchor.rotation() * (distance * p.down);
    point.pixels = p.source;
  }
}

void ProvisionalPoints::measurements(std::span<const VisiblePoint> map_points,
                                     std::vector<LocalMeasurement>* out) const {
  for (const VisiblePoint& p : map_points) {
    if (p.found) out->push_back({p.id, 0, p.pixel.cast<double>(), static_cast<double>(1 << p.level)});
  }
  for (const Point& p : points_) {
    if (p.found && p.refused == 0)
      out->push_back({{}, p.id.value, p.pixel.cast<double>(), static_cast<double>(1 << p.search_level)});
  }
}

void ProvisionalPoints::forget(std::span<const uint64_t> numbers) {
  for (size_t i = points_.size(); i-- > 0;) {
    if (std::find(numbers.begin(), numbers.end(), points_[i].id.value) != numbers.end()) drop(i);
  }
}

void ProvisionalPoints::drop(size_t i) {
  --anchors_[points_[i].anchor].points;
  if (i + 1 < points_.size()) points_[i] = points_.back();
  points_.pop_back();
}

/// Sets the poses of the anchors in this revision. What hung on a keyframe that is gone goes with it.
void ProvisionalPoints::aim_anchors(const MapSnapshot& map) {
  if (map_ != map.map) clear();
  map_ = map.map;
  std::array<bool, kMostAnchors> is_lost{};
  for (size_t i = 0; i < kMostAnchors; ++i) {
    Anchor& anchor = anchors_[i];
    if (anchor.points == 0) continue;
    const KeyframePose* reference = map.find(anchor.reference);
    is_lost[i] = reference == nullptr;
    if (reference != nullptr)
      anchor.anchor_from_map = anchor.camera_from_reference * reference->camera_from_map;
  }
  for (size_t i = points_.size(); i-- > 0;) {
    if (is_lost[points_[i].anchor]) drop(i);
  }
}

/// Sets the place where a pose expects a point, and how its patch looks from there.
void ProvisionalPoints::project(const SE3& camera_from_map, Point* point) {
  point->in_view = false;
  const SE3 camera_from_anchor = camera_from_map * anchors_[point->anchor].anchor_from_map.inverse();
  const Eigen::Matrix3d rotation = camera_from_anchor.rotation_matrix();
  const Eigen::Vector3d direction =
      rotation * point->bearing + point->inverse_depth * camera_from_anchor.translation();
  if (direction.z() <= 0) return;
  Matrix23d d_pixel_d_direction;
  const auto pixel = camera_->project(direction, &d_pixel_d_direction);
  if (!pixel || !camera_->in_image(*pixel)) return;
  const Matrix23d by_anchor = d_pixel_d_direction * rotation;
  Warp warp;
  warp.col(0) = (by_anchor * point->right).cast<float>();
  warp.col(1) = (by_anchor * point->down).cast<float>();
  const auto level = warp_level(warp);
  if (!level) return;
  point->in_view = true;
  point->expected = pixel->cast<float>();
  point->search_level = *level;
  point->warp = warp;
}

void ProvisionalPoints::search(const FrameImages& now, float radius, bool asks_corners, Point* point) {
  point->found = false;
  if (!point->in_view) return;
  const int level = point->search_level;
  const PatchTemplate* patch =
      point->kept.of(point->source, point->warp, level,
                     missing_smear(now.smear.at(point->expected), point->smear), options_.templates);
  if (patch == nullptr) return;
  const GrayImage& image = now.pyramid.level(level);
  const Eigen::Vector2f center(to_level(point->expected.x(), level), to_level(point->expected.y(), level));
  const float reach = radius / static_cast<float>(1 << level);
  auto there = refine_patch(*patch, image, center, options_.iterations, reach);
  if (!there && asks_corners)
    there = look_around(*patch, now, center, reach, options_.iterations, options_.templates);
  if (!there) return;
  point->pixel = {from_level(there->x(), level), from_level(there->y(), level)};
  point->found = true;
}

/// The pose to which the camera has turned from `predicted`, by the points of the coarse level; `predicted`
/// itself where too few of them are found or agree.
SE3 ProvisionalPoints::follow_coarse(const FrameImages& now, const SE3& predicted) {
  for (Point& p : points_) {
    p.found = false;
    project(predicted, &p);
    if (p.level == options_.coarsest_level) search(now, options_.coarse_radius, true, &p);
  }
  observe();
  if (observations_.size() < options_.fewest_coarse) return predicted;
  double inverse_depth = 0;
  for (const BearingObservation& b : observations_) inverse_depth += b.inverse_depth;
  PoseSupplement turned{observations_, std::nullopt};
  turned.position = PositionPrior{
      predicted.center(), options_.turned_only * static_cast<double>(observations_.size()) / inverse_depth};
  PoseOptions options;
  options.min_squared_cutoff = options_.min_squared_cutoff;
  if (!optimize_pose(*camera_, predicted, {}, turned, options, &workspace_, &estimate_)) return predicted;
  return 2 * estimate_.inliers > static_cast<int>(observations_.size()) ? estimate_.camera_from_map
                                                                        : predicted;
}

void ProvisionalPoints::follow(const FrameImages& now, const SE3& predicted, const MapSnapshot& map) {
  aim_anchors(map);
  observations_.clear();
  if (points_.empty()) return;
  const SE3 turned = follow_coarse(now, predicted);
  for (Point& p : points_) {
    if (p.found) continue;
    project(turned, &p);
    search(now, options_.fine_radius, false, &p);
  }
  observe();
}

void ProvisionalPoints::observe() {
  observations_.clear();
  for (const Point& p : points_) {
    if (!p.found) continue;
    const SE3& anchor_from_map = anchors_[p.anchor].anchor_from_map;
    observations_.push_back({anchor_from_map.center(), anchor_from_map.rotation().conjugate() * p.bearing,
                             p.inverse_depth, p.variance, p.pixel.cast<double>(),
                             static_cast<double>(1 << p.search_level)});
  }
}

std::optional<ProvisionalPoints::Located> ProvisionalPoints::locate(const SE3& start,
                                                                    std::span<const VisiblePoint> map_points,
                                                                    double mean_depth) {
  if (observations_.size() < options_.fewest_bearings) return std::nullopt;
  of_map_.clear();
  for (const VisiblePoint& p : map_points) {
    if (p.found) of_map_.push_back({p.position, p.pixel.cast<double>(), static_cast<double>(1 << p.level)});
  }
  PoseOptions options;
  options.min_squared_cutoff = options_.min_squared_cutoff;
  options.max_squared_cutoff = options_.max_squared_cutoff;
  const auto fit = [&](double position_sigma) {
    const PoseSupplement supplement{observations_,
                                    PositionPrior{start.center(), position_sigma * mean_depth}};
    return optimize_pose(*camera_, start, of_map_, supplement, options, &workspace_, &estimate_).has_value();
  };
  if (!fit(options_.free_position)) return std::nullopt;
  const PoseJudgement judgement = judge_pose(estimate_.information, mean_depth, judgement_);
  if (judgement.support == PoseSupport::kNone) return std::nullopt;
  // Half measured it would wander: it stays.
  if (judgement.support == PoseSupport::kRotation && !fit(options_.turned_only)) return std::nullopt;
  const auto first = estimate_.weights.begin() + static_cast<ptrdiff_t>(of_map_.size());
  const auto agree = static_cast<size_t>(
      std::count_if(first, estimate_.weights.end(), [](double weight) { return weight > 0; }));
  if (agree < options_.fewest_bearings || 2 * agree < observations_.size()) return std::nullopt;
  return Located{estimate_.camera_from_map, estimate_.covariance, judgement, agree};
}

/// One scalar Kalman step of the inverse depth by the reprojection; the pose's own uncertainty counts as
/// noise.
bool ProvisionalPoints::measure(const KnownPose& pose, const SE3& camera_from_anchor, bool is_news,
                                Point* point) {
  const Eigen::Vector3d& origin = camera_from_anchor.translation();
  const Eigen::Vector3d direction =
      camera_from_anchor.rotation() * point->bearing + point->inverse_depth * origin;
  Matrix23d d_pixel_d_direction;
  const auto pixel = camera_->project(direction, &d_pixel_d_direction);
  if (!pixel) return false;
  const Eigen::Vector2d by_depth = d_pixel_d_direction * origin;
  Eigen::Matrix<double, 2, 6> by_pose;
  by_pose << point->inverse_depth * d_pixel_d_direction, -d_pixel_d_direction * skew(direction);
  const double sigma = options_.measured_sigma * static_cast<double>(1 << point->search_level);
  const Eigen::Matrix2d noise =
      sigma * sigma * Eigen::Matrix2d::Identity() + by_pose * pose.covariance * by_pose.transpose();
  const Eigen::Vector2d innovation = point->pixel.cast<double>() - *pixel;
  const Eigen::Matrix2d spread = noise + point->variance * by_depth * by_depth.transpose();
  if (innovation.dot(spread.inverse() * innovation) > options_.gate) return false;
  if (!is_news) return true;
  const Eigen::Vector2d weighted = noise.inverse() * by_depth;
  const double information = by_depth.dot(weighted);
  const double prior = point->inverse_depth;
  const double step_variance = 1 / (1 / point->variance + information);
  const double step = step_variance * weighted.dot(innovation);
  // What the measurement alone says of the depth, against what was believed.
  if (information > 0) {
    const double measured = weighted.dot(innovation) / information;
    point->innovation = measured * measured / (point->variance + 1 / information);
  }
  point->inverse_depth = std::max(prior + step, options_.least_inverse / pose.mean_depth);
  point->variance = step_variance;
  return true;
}

void ProvisionalPoints::measure(const KnownPose& pose) {
  std::array<bool, kMostAnchors> is_news{};
  for (size_t i = 0; i < kMostAnchors; ++i) {
    Anchor& anchor = anchors_[i];
    if (anchor.points == 0 || pose.support != PoseSupport::kPosition) continue;
    const Eigen::Vector3d center = anchor.anchor_from_map * pose.camera_from_map.center();
    is_news[i] = (center - anchor.measured_from).norm() > options_.news_distance * pose.mean_depth;
    if (is_news[i]) anchor.measured_from = center;
  }
  for (Point& p : points_) {
    p.innovation = -1;
    if (!p.found) continue;
    const SE3 camera_from_anchor = pose.camera_from_map * anchors_[p.anchor].anchor_from_map.inverse();
    const bool agrees = measure(pose, camera_from_anchor, is_news[p.anchor], &p);
    p.refused = agrees ? 0 : p.refused + 1;
  }
}

void ProvisionalPoints::drop_aged() {
  for (size_t i = points_.size(); i-- > 0;) {
    Point& p = points_[i];
    ++p.age;
    p.unseen = p.found ? 0 : p.unseen + 1;
    const int limit = p.in_view ? options_.miss_limit : options_.unseen_limit;
    if (p.age > options_.oldest || p.unseen > limit || p.refused >= options_.refusals) drop(i);
  }
}

size_t ProvisionalPoints::cell_of(const Eigen::Vector2f& pixel) const {
  const auto cell = [](float at, int size, int cells) {
    return std::clamp(static_cast<int>(at) * cells / size, 0, cells - 1);
  };
  return static_cast<size_t>(cell(pixel.y(), camera_->height(), kRows) * kColumns +
                             cell(pixel.x(), camera_->width(), kColumns));
}

void ProvisionalPoints::fill_cells(std::span<const VisiblePoint> map_points) {
  cells_.fill(0);
  // One point of the server's map holds its cell.
  for (const VisiblePoint& p : map_points) {
    if (p.found) cells_[cell_of(p.pixel)] += is_local(p.id) ? 1 : options_.cell_limit;
  }
  for (const Point& p : points_) {
    if (p.in_view) ++cells_[cell_of(p.found ? p.pixel : p.expected)];
  }
}

bool ProvisionalPoints::has_neighbour(const Eigen::Vector2f& pixel) const {
  return std::any_of(points_.begin(), points_.end(), [&](const Point& p) {
    return p.in_view &&
           ((p.found ? p.pixel : p.expected) - pixel).squaredNorm() < options_.neighbour * options_.neighbour;
  });
}

/// Drops the point that has been out of view for longest, if all places are taken. Returns whether there is
/// room then: not if all are in view.
bool ProvisionalPoints::make_room() {
  if (points_.size() < kMostPoints) return true;
  const auto oldest = std::max_element(points_.begin(), points_.end(), [](const Point& a, const Point& b) {
    return (a.in_view ? -1 : a.unseen) < (b.in_view ? -1 : b.unseen);
  });
  if (oldest->in_view) return false;
  drop(static_cast<size_t>(oldest - points_.begin()));
  return true;
}

std::optional<size_t> ProvisionalPoints::new_anchor(const KnownPose& pose, const MapSnapshot& map) {
  const KeyframePose* nearest = map.nearest_keyframe(pose.camera_from_map.center());
  if (nearest == nullptr) return std::nullopt;
  const auto free = std::min_element(anchors_.begin(), anchors_.end(),
                                     [](const Anchor& a, const Anchor& b) { return a.points < b.points; });
  for (size_t i = points_.size(); i-- > 0 && free->points > 0;) {
    if (&anchors_[points_[i].anchor] == &*free) drop(i);
  }
  *free = {nearest->id, pose.camera_from_map * nearest->camera_from_map.inverse(), 0, pose.camera_from_map,
           Eigen::Vector3d::Zero()};
  return static_cast<size_t>(free - anchors_.begin());
}

bool ProvisionalPoints::begin_point(const FrameImages& now, const KnownPose& pose, int level, Corner corner,
                                    size_t anchor) {
  Point& point = points_.emplace_back();
  if (!cut_source_patch(now.pyramid.level(level), corner, &point.source)) {
    points_.pop_back();
    return false;
  }
  const auto ray = [&](int dx, int dy) {
    return camera_->unproject({from_level(static_cast<float>(corner.x + dx), level),
                               from_level(static_cast<float>(corner.y + dy), level)});
  };
  const auto beside = [&](const Eigen::Vector3d& other) -> Eigen::Vector3d {
    return other / other.dot(point.bearing) - point.bearing;
  };
  point.id = {++last_id_.value};
  point.anchor = anchor;
  point.bearing = ray(0, 0);
  point.right = beside(ray(1, 0));
  point.down = beside(ray(0, 1));
  // Two standard deviations reach from infinity to half of the mean depth.
  point.inverse_depth = 1 / pose.mean_depth;
  point.variance = 0.25 * point.inverse_depth * point.inverse_depth;
  point.level = static_cast<uint8_t>(level);
  point.pixel = point.expected = {from_level(corner.x, level), from_level(corner.y, level)};
  point.in_view = true;
  point.smear = now.smear.at(point.pixel);
  ++anchors_[anchor].points;
  return true;
}

/// The best corner of each cell that wants one.
void ProvisionalPoints::begin_level(const FrameImages& now, const KnownPose& pose, int level, size_t anchor) {
  struct Best {
    Corner corner;
    float score = 0;
  };
  std::array<Best, size_t{kColumns} * kRows> best;
  best.fill({{}, options_.least_texture});
  const GrayImage& image = now.pyramid.level(level);
  for (const Corner& c : now.corners(level).corners) {
    const bool has_room = c.x >= kPatchBorder && c.y >= kPatchBorder && c.x < image.width() - kPatchBorder &&
                          c.y < image.height() - kPatchBorder;
    if (!has_room) continue;
    const size_t cell = cell_of({from_level(c.x, level), from_level(c.y, level)});
    if (cells_[cell] >= options_.cell_limit) continue;
    const float score = shi_tomasi(image, c.x, c.y);
    if (score > best[cell].score) best[cell] = {c, score};
  }
  for (size_t cell = 0; cell < best.size(); ++cell) {
    const Best& b = best[cell];
    if (!(b.score > options_.least_texture)) continue;
    if (has_neighbour({from_level(b.corner.x, level), from_level(b.corner.y, level)})) continue;
    if (!make_room()) return;
    if (!begin_point(now, pose, level, b.corner, anchor)) continue;
    ++cells_[cell];
  }
}

void ProvisionalPoints::begin(const FrameImages& now, const KnownPose& pose, const MapSnapshot& map) {
  const bool has_want =
      std::any_of(cells_.begin(), cells_.end(), [this](int n) { return n < options_.cell_limit; });
  if (++frames_unbegun_ < options_.begin_every || !has_want) return;
  const auto anchor = new_anchor(pose, map);
  if (!anchor) return;
  frames_unbegun_ = 0;
  for (int level = options_.coarsest_level; level >= options_.finest_level; --level)
    begin_level(now, pose, level, *anchor);
}

std::vector<PointCandidate> ProvisionalPoints::candidates(const SE3& camera_from_map) const {
  std::vector<PointCandidate> known;
  for (const Point& p : points_) {
    if (!p.found || p.refused > 0) continue;
    const SE3 camera_from_anchor = camera_from_map * anchors_[p.anchor].anchor_from_map.inverse();
    const Eigen::Vector3d bearing = camera_from_anchor.rotation() * p.bearing;
    const Eigen::Vector3d direction = bearing + p.inverse_depth * camera_from_anchor.translation();
    const double length = direction.norm();
    const double inverse_depth = p.inverse_depth / length;
    const double by_inverse_depth = bearing.dot(direction) / (length * length * length);
    const double sigma = std::abs(by_inverse_depth) * std::sqrt(p.variance);
    if (sigma > options_.known_depth * inverse_depth) continue;
    known.push_back({p.id, p.level, p.pixel, static_cast<float>(inverse_depth), static_cast<float>(sigma)});
  }
  return known;
}

void ProvisionalPoints::update(const FrameImages& now, const KnownPose& pose, const MapSnapshot& map,
                               std::span<const VisiblePoint> map_points) {
  if (pose.support == PoseSupport::kNone) return;
  aim_anchors(map);
  measure(pose);
  drop_aged();
  fill_cells(map_points);
  begin(now, pose, map);
}

}  // namespace cairn
