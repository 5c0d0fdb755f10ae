// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/epipolar_search.h"

#include <algorithm>
#include <cmath>

#include "common/geometry/triangulation.h"

namespace cairn {
namespace {

constexpr int kTemplateMargin = 5;  ///< [level px] of a template's window from the image's border

/// A pixel coordinate as a whole number, clamped: a line may end far outside of the image.
int whole(float pixel) {
  constexpr float kFar = 1e6F;
  return static_cast<int>(std::clamp(pixel, -kFar, kFar));
}

/// The pixels within `line_distance` and a half, for rounding, of a piece of line [level px], across the
/// direction in which it is thin, where templates fit. `runs` is replaced.
void mark_strip(const Eigen::Vector2f& begin, const Eigen::Vector2f& end, const GrayView& image,
                int line_distance, std::vector<PixelRun>* runs) {
  const float half_width = static_cast<float>(line_distance) + 0.5F;
  constexpr float kLevel = 1e-3F;  // [px] less of a rise is none
  runs->clear();
  if (!begin.allFinite() || !end.allFinite()) return;
  const Eigen::Vector2f line = end - begin;
  const bool is_flat = std::abs(line.x()) > std::abs(line.y());
  const Eigen::Vector2f reach =
      is_flat ? Eigen::Vector2f(0.5F, half_width) : Eigen::Vector2f(half_width, 0.5F);
  const Eigen::Vector2f least = begin.cwiseMin(end) - reach;
  const Eigen::Vector2f most = begin.cwiseMax(end) + reach;
  const float columns_per_row = line.x() / (std::abs(line.y()) < kLevel ? kLevel : line.y());
  const float beside = is_flat ? half_width * std::abs(columns_per_row) : half_width;
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

Eigen::Vector3d point_at(const PointSource& source, double inverse_depth) {
  const Eigen::Vector3d ray = source.ray_center.cast<double>();
  return ray / (ray.z() * inverse_depth);
}

}  // namespace

EpipolarSearch::EpipolarSearch(const MapKeyframe& keyframe, const MapKeyframe& partner, double min_parallax,
                               const EpipolarOptions& options)
    : options_(options),
      partner_(partner),
      source_camera_(*keyframe.camera),
      partner_from_source_(partner.camera_from_map * keyframe.camera_from_map.inverse()),
      min_parallax_(min_parallax),
      seen_{1.0 / (options.far_margin * keyframe.far_depth),
            1.0 / (options.near_margin * keyframe.near_depth)} {}

std::optional<NewPoint> EpipolarSearch::find(const PointSource& source) {
  const auto found = find_match(source, seen_);
  if (!found) return std::nullopt;
  return triangulate_match(source, *found);
}

std::optional<PatchFound> EpipolarSearch::find_match(const PointSource& source, const InverseDepths& depths) {
  collect_matches(source, depths);
  const LineMatch* best = unique_best();
  if (!best) return std::nullopt;
  const auto view = view_at(source, best->inverse_depth);
  if (!view) return std::nullopt;
  return refine_from(source, *view, *partner_.images, best->pixel, options_.unique_distance);
}

std::optional<PatchView> EpipolarSearch::view_at(const PointSource& source, double inverse_depth) const {
  return view_patch(source, point_at(source, inverse_depth), partner_from_source_, *partner_.camera);
}

std::optional<Eigen::Vector2d> EpipolarSearch::pixel_at(const PointSource& source,
                                                        double inverse_depth) const {
  return partner_.camera->project(partner_from_source_ * point_at(source, inverse_depth));
}

// The line is walked in pieces: with distortion it is a curve, and the warp changes along it.
void EpipolarSearch::collect_matches(const PointSource& source, const InverseDepths& depths) {
  matches_.clear();
  limit_ = kSearchZmssd;
  const auto near_pixel = pixel_at(source, depths.most);
  const auto far_pixel = pixel_at(source, depths.least);
  int segments = options_.max_segments / 2;
  if (near_pixel && far_pixel) {
    const double length = (*near_pixel - *far_pixel).norm() / (1 << source.level);
    segments =
        std::clamp(static_cast<int>(std::ceil(length / options_.segment_length)), 1, options_.max_segments);
  }
  const double step = (depths.most - depths.least) / segments;
  auto begin = far_pixel;
  for (int i = 0; i < segments; ++i) {
    const double inverse_depth = depths.least + i * step;
    const auto end = pixel_at(source, inverse_depth + step);
    if (begin && end)
      search_segment(source, inverse_depth + 0.5 * step, begin->cast<float>(), end->cast<float>());
    begin = end;
  }
}

void EpipolarSearch::search_segment(const PointSource& source, double inverse_depth,
                                    const Eigen::Vector2f& begin, const Eigen::Vector2f& end) {
  const auto view = view_at(source, inverse_depth);
  if (!view || !make_template(source.pixels, view->warp, view->level, &patch_)) return;
  const int level = view->level;
  const GrayView image = partner_.images->level(level);
  mark_strip({to_level(begin.x(), level), to_level(begin.y(), level)},
             {to_level(end.x(), level), to_level(end.y(), level)}, image, options_.line_distance, &runs_);
  alike_.clear();
  if (const BoxSums* sums = sums_at(level)) {
    search_zmssd(patch_, image, *sums, runs_, options_.unique_ratio, &limit_, &alike_);
  } else {
    search_zmssd(patch_, image, runs_, options_.unique_ratio, &limit_, &alike_);
  }
  for (const PatchMatch& m : alike_) {
    const Eigen::Vector2f pixel(from_level(m.corner.x, level), from_level(m.corner.y, level));
    matches_.push_back({m.zmssd, level, pixel, inverse_depth});
  }
}

/// Box sums of a level; null until so many of its windows were compared that its sums are worth their time.
const BoxSums* EpipolarSearch::sums_at(int level) {
  auto& [windows, sums] = levels_[static_cast<size_t>(level)];
  if (sums) return &*sums;
  for (const PixelRun& run : runs_) windows += std::max(0, run.last - run.first + 1);
  const GrayView image = partner_.images->level(level);
  if (windows < image.width * image.height / options_.pixels_per_window) return nullptr;
  return &sums.emplace(image);
}

const EpipolarSearch::LineMatch* EpipolarSearch::unique_best() const {
  const auto best =
      std::min_element(matches_.begin(), matches_.end(),
                       [](const LineMatch& a, const LineMatch& b) { return a.zmssd < b.zmssd; });
  if (best == matches_.end()) return nullptr;
  const float apart = options_.unique_distance * static_cast<float>(1 << best->level);
  for (const LineMatch& rival : matches_) {
    if ((rival.pixel - best->pixel).norm() > apart &&
        static_cast<float>(best->zmssd) > options_.unique_ratio * static_cast<float>(rival.zmssd))
      return nullptr;
  }
  return &*best;
}

std::optional<NewPoint> EpipolarSearch::triangulate_match(const PointSource& source,
                                                          const PatchFound& found) const {
  const Eigen::Vector3d ray_b = partner_.camera->unproject(found.pixel.cast<double>());
  const auto point = triangulate(partner_from_source_, source.ray_center.cast<double>(), ray_b);
  if (!point) return std::nullopt;
  const Eigen::Vector3d center_b = partner_from_source_.center();
  if (parallax(*point, Eigen::Vector3d::Zero(), center_b) < min_parallax_) return std::nullopt;
  if (point->z() * seen_.least > 1.0 || point->z() * seen_.most < 1.0) return std::nullopt;
  const Eigen::Vector2d corner = pixel_of(source).cast<double>();
  const auto in_source = source_camera_.project(*point);
  const auto in_partner = partner_.camera->project(partner_from_source_ * *point);
  if (!in_source || !in_partner) return std::nullopt;
  const double source_sigma = 1 << source.level;
  const double partner_sigma = 1 << found.level;
  if ((*in_source - corner).squaredNorm() > options_.max_squared_residual * source_sigma * source_sigma)
    return std::nullopt;
  if ((*in_partner - found.pixel.cast<double>()).squaredNorm() >
      options_.max_squared_residual * partner_sigma * partner_sigma) {
    return std::nullopt;
  }
  return NewPoint{*point, found};
}

Eigen::Vector2f pixel_of(const PointSource& source) {
  return {from_level(source.corner.x, source.level), from_level(source.corner.y, source.level)};
}

PointId add_point(MapState* map, const PointSource& source, const Eigen::Vector3d& in_source,
                  const std::vector<std::pair<KeyframeId, PatchFound>>& seen_by) {
  const SE3 map_from_source = map->keyframe(source.keyframe).camera_from_map.inverse();
  const PointId id = map->add_point(source, map_from_source * in_source);
  map->add_measurement(source.keyframe, {id, source.level, pixel_of(source)});
  for (const auto& [observer, found] : seen_by)
    map->add_measurement(observer, {id, found.level, found.pixel});
  return id;
}

}  // namespace cairn
