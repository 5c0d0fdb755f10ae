// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "common/image/box_sums.h"
#include "server/mapping/map_maker_options.h"
#include "server/mapping/patch_view.h"

/// A corner of one keyframe looked for in another, along the line that its ray draws there.
namespace cairn {

/// A candidate for a point: its position in the source camera's frame, and where another keyframe shows it.
struct NewPoint {
  Eigen::Vector3d in_source = Eigen::Vector3d::Zero();
  PatchFound found;
};

/// Range of inverse depths in which a match is looked for: inverse z in the source's camera [1 / map unit], 0
/// < least < most.
struct InverseDepths {
  double least = 0;
  double most = 0;
};

/// Searches corners of one keyframe in one partner. Both outlive it and keep their places.
class EpipolarSearch {
 public:
  /// `min_parallax` [rad] of a point.
  EpipolarSearch(const MapKeyframe& keyframe, const MapKeyframe& partner, double min_parallax,
                 const EpipolarOptions& options);

  /// Finds a point at the depths that the keyframe sees: its match is unique along the line, it is
  /// triangulated with at least `min_parallax`, and it reprojects to within a sigma (EpipolarOptions) in both
  /// keyframes.
  [[nodiscard]] std::optional<NewPoint> find(const PointSource& source);
  /// Finds the only place along the line of these depths that resembles the source, to sub-pixel; nothing if
  /// there is none, or if a rival resembles it about as much (EpipolarOptions::unique_ratio).
  [[nodiscard]] std::optional<PatchFound> find_match(const PointSource& source, const InverseDepths& depths);

  [[nodiscard]] std::optional<PatchView> view_at(const PointSource& source, double inverse_depth) const;
  [[nodiscard]] std::optional<Eigen::Vector2d> pixel_at(const PointSource& source,
                                                        double inverse_depth) const;

 private:
  /// A pixel on the line that resembles the patch.
  struct LineMatch {
    int zmssd = 0;
    int level = 0;
    Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< level 0
    double inverse_depth = 0;                         ///< of the hypothesis whose warp was used
  };

  struct SearchedLevel {
    int windows = 0;  ///< number of windows compared so far
    std::optional<BoxSums> sums;
  };

  void collect_matches(const PointSource& source, const InverseDepths& depths);
  void search_segment(const PointSource& source, double inverse_depth, const Eigen::Vector2f& begin,
                      const Eigen::Vector2f& end);
  const BoxSums* sums_at(int level);
  [[nodiscard]] const LineMatch* unique_best() const;
  [[nodiscard]] std::optional<NewPoint> triangulate_match(const PointSource& source,
                                                          const PatchFound& found) const;

  EpipolarOptions options_;
  const MapKeyframe& partner_;
  const Camera& source_camera_;
  SE3 partner_from_source_;
  double min_parallax_;                                 ///< [rad]
  InverseDepths seen_;                                  ///< depths that the keyframe sees, with margins
  std::array<SearchedLevel, kPyramidLevels> levels_{};  ///< of the partner
  // Of the point that is looked for:
  PatchTemplate patch_;
  std::vector<PixelRun> runs_;
  std::vector<PatchMatch> alike_;
  std::vector<LineMatch> matches_;
  int limit_ = kSearchZmssd;  ///< ZMSSD that a match or a rival of the best must be below
};

/// Centre of a source in its keyframe [level-0 px].
[[nodiscard]] Eigen::Vector2f pixel_of(const PointSource& source);

/// Adds a new point, with its measurements in the source keyframe and in those that see it. `in_source`:
/// position in the source camera's frame.
PointId add_point(MapState* map, const PointSource& source, const Eigen::Vector3d& in_source,
                  const std::vector<std::pair<KeyframeId, PatchFound>>& seen_by);

}  // namespace cairn
