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

/// A candidate for a point: where it is, and where another keyframe shows it.
struct NewPoint {
  Eigen::Vector3d in_source = Eigen::Vector3d::Zero();
  PatchFound found;
};

/// What depths are looked for: inverse z in the source's camera [1 / map unit], 0 < least < most.
struct InverseDepths {
  double least = 0;
  double most = 0;
};

/// The search for corners of one keyframe in one partner. Both outlive it and keep their places.
class EpipolarSearch {
 public:
  /// `min_parallax` [rad] of a point.
  EpipolarSearch(const MapKeyframe& keyframe, const MapKeyframe& partner, double min_parallax,
                 const EpipolarOptions& options);

  /// At the depths that the keyframe sees: unique along the line, triangulated, at so much parallax [rad] or
  /// more, and reprojected to within a sigma in both.
  [[nodiscard]] std::optional<NewPoint> find(const PointSource& source);
  /// What alone of all along the line of these depths resembles the source, to sub-pixel.
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
    int windows = 0;  ///< looked at, of `runs_`
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
  InverseDepths seen_;                                  ///< by the keyframe
  std::array<SearchedLevel, kPyramidLevels> levels_{};  ///< of the partner
  // Of the point that is looked for:
  PatchTemplate patch_;
  std::vector<PixelRun> runs_;
  std::vector<PatchMatch> alike_;
  std::vector<LineMatch> matches_;
  int limit_ = kSearchZmssd;  ///< ZMSSD that a match or a rival of the best must be below
};

/// Where the centre of a source is in its keyframe, level-0 px.
[[nodiscard]] Eigen::Vector2f pixel_of(const PointSource& source);

/// A new point with its measurements in the source keyframe and in those that see it.
PointId add_point(MapState* map, const PointSource& source, const Eigen::Vector3d& in_source,
                  const std::vector<std::pair<KeyframeId, PatchFound>>& seen_by);

}  // namespace cairn
