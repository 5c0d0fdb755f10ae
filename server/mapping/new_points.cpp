// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/new_points.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>

#include "common/base/median.h"
#include "common/geometry/triangulation.h"
#include "common/image/window_sums.h"
#include "server/mapping/patch_view.h"

namespace cairn {
namespace {

constexpr double kMinParallax =
    0.0175;  ///< [rad] 1 degree: below, depth is noise (0.3 px at f 525 is 3 % of it)
constexpr double kGoodParallax =
    0.07;  ///< [rad] from here on more does not help, and patches begin to differ
constexpr double kWideParallax = 0.25;  ///< [rad] from here on patches and occlusions differ too much
constexpr double kNearMargin = 0.6;  ///< depths searched, relative to the keyframe's 5th percentile of depth
constexpr double kFarMargin = 1.8;   ///< and to its 95th
constexpr double kKnownDistance = 10;  ///< [level px] of a candidate from a known measurement (PTAM r114)
constexpr double kNewDistance = 6;     ///< [level px] between new points of one level
constexpr int kLineDistance = 2;       ///< [level px] searched on either side of the epipolar line
constexpr int kTemplateMargin = 5;     ///< [level px] of a template's window from the image's border
constexpr double kSegmentLength =
    24;  ///< [source-level px] of the line that shares one warp and counts as straight
constexpr int kMaxSegments = 16;
constexpr double kMaxSquaredResidual = 1.0;  ///< of a new point in its two views, units of sigma
constexpr float kUniqueDistance = 3.0F;      ///< [level px] a rival is a corner farther away than this
constexpr float kUniqueRatio = 0.7F;         ///< best ZMSSD over the best rival's
constexpr float kWitnessRadius = 3.0F;       ///< [level px]
constexpr double kWitnessCosine =
    0.9;  ///< a view more oblique against the source's proves nothing by not finding
constexpr int kOverlapSamples = 60;
constexpr size_t kCandidatesPerPoll = 64;

/// A raster of what is taken, for thinning in constant time.
class Occupancy {
 public:
  Occupancy(int width, int height)
      : width_(width), height_(height), taken_(static_cast<size_t>(width) * static_cast<size_t>(height), 0) {}

  void take_disc(double x, double y, double radius) {
    const int y0 = std::max(0, static_cast<int>(std::ceil(y - radius)));
    const int y1 = std::min(height_ - 1, static_cast<int>(std::floor(y + radius)));
    for (int j = y0; j <= y1; ++j) {
      const double half = std::sqrt(std::max(0.0, radius * radius - (j - y) * (j - y)));
      const int x0 = std::max(0, static_cast<int>(std::ceil(x - half)));
      const int x1 = std::min(width_ - 1, static_cast<int>(std::floor(x + half)));
      if (x0 <= x1) std::fill_n(taken_.begin() + j * width_ + x0, x1 - x0 + 1, uint8_t{1});
    }
  }
  [[nodiscard]] bool is_taken(Corner c) const { return taken_[static_cast<size_t>(c.y * width_ + c.x)] != 0; }

 private:
  int width_;
  int height_;
  std::vector<uint8_t> taken_;
};

/// A corner on the epipolar line that resembles the patch.
struct LineMatch {
  int zmssd = 0;
  int level = 0;
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< level 0
  double inverse_depth = 0;                         ///< of the hypothesis whose warp was used
};

struct NewPoint {
  Eigen::Vector3d in_source = Eigen::Vector3d::Zero();
  PatchFound found;
};

/// Where a whole pixel is; a line may end far outside of the picture.
int whole(float pixel) {
  constexpr float kFar = 1e6F;
  return static_cast<int>(std::clamp(pixel, -kFar, kFar));
}

/// The pixels within kLineDistance and a half, for rounding, of a piece of line [level px], across the
/// direction in which it is thin, where templates fit. `runs` is replaced.
void mark_strip(const Eigen::Vector2f& begin, const Eigen::Vector2f& end, const GrayView& image,
                std::vector<PixelRun>* runs) {
  constexpr float kHalfWidth = kLineDistance + 0.5F;
  constexpr float kLevel = 1e-3F;  // [px] less of a rise is none
  runs->clear();
  if (!begin.allFinite() || !end.allFinite()) return;
  const Eigen::Vector2f line = end - begin;
  const bool is_flat = std::abs(line.x()) > std::abs(line.y());
  const Eigen::Vector2f reach =
      is_flat ? Eigen::Vector2f(0.5F, kHalfWidth) : Eigen::Vector2f(kHalfWidth, 0.5F);
  const Eigen::Vector2f least = begin.cwiseMin(end) - reach;
  const Eigen::Vector2f most = begin.cwiseMax(end) + reach;
  const float columns_per_row = line.x() / (std::abs(line.y()) < kLevel ? kLevel : line.y());
  const float beside = is_flat ? kHalfWidth * std::abs(columns_per_row) : kHalfWidth;
  const int top = std::max(kTemplateMargin, whole(std::ceil(least.y())));
  const int bottom = std::min(image.height - kTemplateMargin - 1, whole(std::floor(most.y())));
  for (int row = top; row <= bottom; ++row) {
    const float middle = begin.x() + (static_cast<float>(row) - begin.y()) * columns_per_row;
    const int first = whole(std::ceil(std::max(middle - beside, least.x())));
    const int last = whole(std::floor(std::min(middle + beside, most.x())));
    runs->push_back(
        {row, std::max(first, kTemplateMargin), std::min(last, image.width - kTemplateMargin - 1)});
  }
}

/// The search for one keyframe in one partner.
class EpipolarSearch {
 public:
  EpipolarSearch(const MapKeyframe& keyframe, const MapKeyframe& partner)
      : partner_(partner),
        source_camera_(*keyframe.camera),
        partner_from_source_(partner.camera_from_map * keyframe.camera_from_map.inverse()),
        min_inverse_depth_(1.0 / (kFarMargin * keyframe.far_depth)),
        max_inverse_depth_(1.0 / (kNearMargin * keyframe.near_depth)) {}

  [[nodiscard]] std::optional<NewPoint> find(const PointSource& source) {
    collect_matches(source);
    const LineMatch* best = unique_best();
    if (!best) return std::nullopt;
    const auto view = view_at(source, best->inverse_depth);
    if (!view) return std::nullopt;
    const auto found = refine_from(source, *view, *partner_.images, best->pixel, kUniqueDistance);
    if (!found) return std::nullopt;
    return triangulate_match(source, *found);
  }

 private:
  [[nodiscard]] static Eigen::Vector3d point_at(const PointSource& source, double inverse_depth) {
    const Eigen::Vector3d ray = source.ray_center.cast<double>();
    return ray / (ray.z() * inverse_depth);
  }
  [[nodiscard]] std::optional<PatchView> view_at(const PointSource& source, double inverse_depth) const {
    return view_patch(source, point_at(source, inverse_depth), partner_from_source_, *partner_.camera);
  }
  [[nodiscard]] std::optional<Eigen::Vector2d> pixel_at(const PointSource& source,
                                                        double inverse_depth) const {
    return partner_.camera->project(partner_from_source_ * point_at(source, inverse_depth));
  }

  // The line is walked in pieces: with distortion it is a curve, and the warp changes along it.
  void collect_matches(const PointSource& source) {
    matches_.clear();
    limit_ = kSearchZmssd;
    const auto near_pixel = pixel_at(source, max_inverse_depth_);
    const auto far_pixel = pixel_at(source, min_inverse_depth_);
    int segments = kMaxSegments / 2;
    if (near_pixel && far_pixel) {
      const double length = (*near_pixel - *far_pixel).norm() / (1 << source.level);
      segments = std::clamp(static_cast<int>(std::ceil(length / kSegmentLength)), 1, kMaxSegments);
    }
    const double step = (max_inverse_depth_ - min_inverse_depth_) / segments;
    auto begin = far_pixel;
    for (int i = 0; i < segments; ++i) {
      const double inverse_depth = min_inverse_depth_ + i * step;
      const auto end = pixel_at(source, inverse_depth + step);
      if (begin && end)
        search_segment(source, inverse_depth + 0.5 * step, begin->cast<float>(), end->cast<float>());
      begin = end;
    }
  }

  void search_segment(const PointSource& source, double inverse_depth, const Eigen::Vector2f& begin,
                      const Eigen::Vector2f& end) {
    const auto view = view_at(source, inverse_depth);
    if (!view || !make_template(source.pixels, view->warp, view->level, &patch_)) return;
    const int level = view->level;
    const GrayView image = partner_.images->level(level);
    mark_strip({to_level(begin.x(), level), to_level(begin.y(), level)},
               {to_level(end.x(), level), to_level(end.y(), level)}, image, &runs_);
    alike_.clear();
    find_alike(patch_, image, sums_at(level), runs_, kUniqueRatio, &limit_, &alike_);
    for (const PatchMatch& m : alike_) {
      const Eigen::Vector2f pixel(from_level(m.corner.x, level), from_level(m.corner.y, level));
      matches_.push_back({m.zmssd, level, pixel, inverse_depth});
    }
  }

  const WindowSums& sums_at(int level) {
    auto& sums = sums_[static_cast<size_t>(level)];
    if (!sums) sums.emplace(partner_.images->level(level));
    return *sums;
  }

  [[nodiscard]] const LineMatch* unique_best() const {
    const auto best =
        std::min_element(matches_.begin(), matches_.end(),
                         [](const LineMatch& a, const LineMatch& b) { return a.zmssd < b.zmssd; });
    if (best == matches_.end()) return nullptr;
    const float apart = kUniqueDistance * static_cast<float>(1 << best->level);
    for (const LineMatch& rival : matches_) {
      if ((rival.pixel - best->pixel).norm() > apart &&
          static_cast<float>(best->zmssd) > kUniqueRatio * static_cast<float>(rival.zmssd))
        return nullptr;
    }
    return &*best;
  }

  [[nodiscard]] std::optional<NewPoint> triangulate_match(const PointSource& source,
                                                          const PatchFound& found) const {
    const Eigen::Vector3d ray_b = partner_.camera->unproject(found.pixel.cast<double>());
    const auto point = triangulate(partner_from_source_, source.ray_center.cast<double>(), ray_b);
    if (!point) return std::nullopt;
    const Eigen::Vector3d center_b = partner_from_source_.center();
    if (parallax(*point, Eigen::Vector3d::Zero(), center_b) < kMinParallax) return std::nullopt;
    if (point->z() * min_inverse_depth_ > 1.0 || point->z() * max_inverse_depth_ < 1.0) return std::nullopt;
    const Eigen::Vector2d corner(from_level(source.corner.x, source.level),
                                 from_level(source.corner.y, source.level));
    const auto in_source = source_camera_.project(*point);
    const auto in_partner = partner_.camera->project(partner_from_source_ * *point);
    if (!in_source || !in_partner) return std::nullopt;
    const double source_sigma = 1 << source.level;
    const double partner_sigma = 1 << found.level;
    if ((*in_source - corner).squaredNorm() > kMaxSquaredResidual * source_sigma * source_sigma)
      return std::nullopt;
    if ((*in_partner - found.pixel.cast<double>()).squaredNorm() >
        kMaxSquaredResidual * partner_sigma * partner_sigma) {
      return std::nullopt;
    }
    return NewPoint{*point, found};
  }

  const MapKeyframe& partner_;
  const Camera& source_camera_;
  SE3 partner_from_source_;
  double min_inverse_depth_;
  double max_inverse_depth_;
  std::array<std::optional<WindowSums>, kPyramidLevels> sums_{};  ///< of the partner's levels, once needed
  // Of the point that is looked for:
  PatchTemplate patch_;
  std::vector<PixelRun> runs_;
  std::vector<PatchMatch> alike_;
  std::vector<LineMatch> matches_;
  int limit_ = kSearchZmssd;  ///< ZMSSD that a match or a rival of the best must be below
};

/// Asks keyframes that should see a new point too. False: at least two should, and none does.
class Witnesses {
 public:
  Witnesses(const MapState& map, const MapKeyframe& keyframe, std::vector<KeyframeId> ids)
      : ids_(std::move(ids)) {
    for (const KeyframeId id : ids_) {
      keyframes_.push_back(&map.keyframe(id));
      from_source_.push_back(keyframes_.back()->camera_from_map * keyframe.camera_from_map.inverse());
    }
  }

  bool confirm(const PointSource& source, const NewPoint& point, KeyframeId partner,
               std::vector<std::pair<KeyframeId, PatchFound>>* found) const {
    int asked = 0;
    found->clear();
    for (size_t i = 0; i < ids_.size(); ++i) {
      if (ids_[i] == partner) continue;
      const Eigen::Vector3d to_witness = (from_source_[i].center() - point.in_source).normalized();
      if (to_witness.dot(-point.in_source.normalized()) < kWitnessCosine) continue;
      const auto view = view_patch(source, point.in_source, from_source_[i], *keyframes_[i]->camera);
      if (!view || !keyframes_[i]->camera->in_image(view->pixel, 8 << view->level)) continue;
      ++asked;
      const auto hit = find_near_corner(source, *view, *keyframes_[i]->images, kWitnessRadius);
      if (hit) found->emplace_back(ids_[i], *hit);
    }
    return asked < 2 || !found->empty();
  }

 private:
  std::vector<KeyframeId> ids_;
  std::vector<const MapKeyframe*> keyframes_;
  std::vector<SE3> from_source_;
};

Occupancy known_measurements(const MapKeyframe& keyframe, int level) {
  const GrayView image = keyframe.images->level(level);
  Occupancy taken(image.width, image.height);
  for (const Measurement& m : keyframe.measurements) {
    if (m.level != level && m.level != level + 1) continue;
    taken.take_disc(to_level(m.pixel.x(), level), to_level(m.pixel.y(), level), kKnownDistance);
  }
  return taken;
}

/// A new point with its measurements in the source keyframe and in those that see it.
PointId add_point(MapState* map, const PointSource& source, const NewPoint& point,
                  const std::vector<std::pair<KeyframeId, PatchFound>>& seen_by) {
  const SE3 map_from_source = map->keyframe(source.keyframe).camera_from_map.inverse();
  const PointId id = map->add_point(source, map_from_source * point.in_source);
  const Eigen::Vector2f pixel(from_level(source.corner.x, source.level),
                              from_level(source.corner.y, source.level));
  map->add_measurement(source.keyframe, {id, source.level, pixel});
  for (const auto& [observer, found] : seen_by)
    map->add_measurement(observer, {id, found.level, found.pixel});
  return id;
}

std::vector<Candidate> strongest_first(std::vector<Candidate> candidates) {
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
  return candidates;
}

}  // namespace

std::vector<KeyframeId> choose_partners(const MapState& map, KeyframeId keyframe_id, size_t count) {
  const MapKeyframe& keyframe = map.keyframe(keyframe_id);
  const Eigen::Vector3d center = keyframe.camera_from_map.center();
  const size_t stride = std::max<size_t>(1, keyframe.measurements.size() / kOverlapSamples);
  std::vector<std::pair<double, KeyframeId>> ranked;
  for (const MapKeyframe& other : map.keyframes()) {
    if (!other.live || other.id == keyframe_id) continue;
    const Eigen::Vector3d other_center = other.camera_from_map.center();
    std::vector<double> angles;
    for (size_t i = 0; i < keyframe.measurements.size(); i += stride) {
      const Eigen::Vector3d& point = map.point(keyframe.measurements[i].point).position;
      const auto pixel = other.camera->project(other.camera_from_map * point);
      if (pixel && other.camera->in_image(*pixel)) angles.push_back(parallax(point, center, other_center));
    }
    if (angles.empty()) continue;
    const double angle = reorder_to_median(std::span(angles));
    if (angle < kMinParallax) continue;
    const double usefulness = std::min({1.0, angle / kGoodParallax, kWideParallax / angle});
    ranked.emplace_back(-usefulness * static_cast<double>(angles.size()), other.id);
  }
  std::sort(ranked.begin(), ranked.end());
  std::vector<KeyframeId> partners;
  for (size_t i = 0; i < std::min(count, ranked.size()); ++i) partners.push_back(ranked[i].second);
  return partners;
}

NewPoints make_new_points(MapState* map, KeyframeId keyframe_id, int level, const NewPointsOptions& options,
                          const std::function<bool()>& should_yield) {
  const MapKeyframe& keyframe = map->keyframe(keyframe_id);
  NewPoints result;
  if (keyframe.near_depth <= 0) return result;
  const std::vector<KeyframeId> others =
      choose_partners(*map, keyframe_id, static_cast<size_t>(options.partners + options.witnesses));
  std::vector<EpipolarSearch> searches;
  for (size_t i = 0; i < std::min(others.size(), static_cast<size_t>(options.partners)); ++i) {
    searches.emplace_back(keyframe, map->keyframe(others[i]));
  }
  const Witnesses witnesses(*map, keyframe, others);
  Occupancy taken = known_measurements(keyframe, level);
  std::vector<std::pair<KeyframeId, PatchFound>> seen_by;
  const std::vector<Candidate> candidates = strongest_first(point_candidates(*keyframe.images, level));
  for (size_t c = options.first_candidate; c < candidates.size(); ++c) {
    if (static_cast<int>(result.made.size()) >= options.max_points) break;
    if (c % kCandidatesPerPoll == kCandidatesPerPoll - 1 && should_yield()) {
      result.next_candidate = c;
      result.finished = false;
      break;
    }
    const Corner corner = candidates[c].corner;
    if (taken.is_taken(corner)) continue;
    const auto source = make_source(keyframe, level, corner);
    if (!source) continue;
    for (size_t i = 0; i < searches.size(); ++i) {
      const auto point = searches[i].find(*source);
      if (!point || !witnesses.confirm(*source, *point, others[i], &seen_by)) continue;
      seen_by.emplace_back(others[i], point->found);
      result.made.push_back(add_point(map, *source, *point, seen_by));
      taken.take_disc(corner.x, corner.y, kNewDistance);
      break;
    }
  }
  return result;
}

}  // namespace cairn
