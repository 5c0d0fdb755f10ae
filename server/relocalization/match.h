// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "common/geometry/pose.h"
#include "common/image/place.h"
#include "server/relocalization/place_index.h"

/// Corners of a query matched with points of keyframes by their descriptors.
namespace cairn {

/// Limits of the matching. DECISION.md says what sets them.
struct MatchOptions {
  int max_distance = 70;  ///< [bits of 256] largest distance of a match without a pose to guide it
  float ratio = 0.85F;    ///< largest distance of a match, over that of its best rival (Lowe, IJCV 2004)
  /// [px of level 0 times 2^level] Points of two scales that lie nearer to each other than this are one
  /// corner, and no rivals. Matches that lie nearer [px] do not support each other.
  float same_place = 6;
  int max_guided_distance = 60;  ///< [bits of 256] largest distance of a match near where a pose expects it
  float neighbourhood = 80;      ///< [px] distance in the keyframe within which matches are neighbours
  /// [px] Difference of two neighbours' motions that noise explains, at a coarse level.
  float motion_noise = 8;
  /// [px of motion per px apart] Further difference that change of scale, roll and slant explain.
  float motion_change = 0.25F;
  /// Number of neighbours that must have moved alike for a match to be supported.
  int fewest_supporters = 2;

  /// [bits of 256] The farthest rival that can still refuse a match.
  [[nodiscard]] int max_rival_distance() const {
    return static_cast<int>(static_cast<float>(max_distance) / ratio);
  }
};

/// A corner of the query and the map point that it shows, perhaps.
struct PlaceMatch {
  size_t corner = 0;  ///< index into PlaceView::corners
  PointId point;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< map frame
  int distance = 0;
  Eigen::Vector2f there = Eigen::Vector2f::Zero();  ///< where the keyframe saw it [level-0 px]
};

/// For each corner of a view the vocabulary cells in which points are looked for that may be the same.
[[nodiscard]] std::vector<CellList> probed_cells(const PlaceView& view);

/// The result of the cheap match of every second corner with a keyframe. Where none of these matches is
/// supported (keep_supported()) the place is another, nearly always. Asking for three or four that are
/// supported lost right answers (trials: tests/bench/HISTORY.md).
struct Prefilter {
  std::vector<PlaceMatch> matches;  ///< in the order of corners, a point perhaps more than once
  size_t distinct = 0;              ///< number of these, each point counted once
  size_t supported = 0;             ///< number of the distinct ones that neighbours support
};
[[nodiscard]] Prefilter run_prefilter(const PlaceView& view, std::span<const CellList> cells,
                                      const IndexedMap& map, size_t keyframe, const MatchOptions& options);
/// Matches every corner with the point of the keyframe, as it looks at about the view's exposure, that looks
/// most like it, of those in the corner's cells at its own pyramid level and one up or down. Kept are matches
/// clearly better than the best rival elsewhere in the keyframe; each point once. Points that left the map
/// are passed over. In the order of corners. `prefilter`: its result there, whose matches need not be looked
/// for again.
[[nodiscard]] std::vector<PlaceMatch> match_closer(const PlaceView& view, std::span<const CellList> cells,
                                                   const IndexedMap& map, size_t keyframe,
                                                   const Prefilter& prefilter, const MatchOptions& options);

/// The corners of a query in square cells, level by level, to find those near a pixel.
class CornerGrid {
 public:
  CornerGrid(const PlaceView& view, const Camera& camera);

  /// A corner and where it is.
  struct Entry {
    Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
    uint32_t corner = 0;  ///< index into PlaceView::corners
  };
  /// The corner at a position in the grid, and its descriptor.
  [[nodiscard]] const Entry& entry(uint32_t position) const { return entries_[position]; }
  [[nodiscard]] const Descriptor& descriptor(uint32_t position) const { return descriptors_[position]; }
  /// Appends the positions of a level's corners within `radius` level-0 px.
  void find(const Eigen::Vector2d& pixel, int level, double radius, std::vector<uint32_t>* out) const;

 private:
  /// Cells of a level: the corners in cell (column, row) are [begin[i], begin[i + 1]) of the entries, where i
  /// = row * columns + column.
  struct Level {
    double cell = 1;  ///< px of level 0
    int columns = 0;
    int rows = 0;
    std::vector<uint32_t> begin;
    [[nodiscard]] int column_of(double x) const;
    [[nodiscard]] int row_of(double y) const;
  };
  std::array<Level, kPyramidLevels> levels_;
  std::vector<Entry> entries_;
  std::vector<Descriptor> descriptors_;  ///< of `entries_`
};

/// A point of the map where a pose puts it in the query.
struct ProjectedPoint {
  PointId id;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< map frame
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();     ///< level 0
  double depth = 0;                                    ///< [map unit] in the query's camera
  uint32_t first_sighting = 0;                         ///< index into ProjectedPoints::sightings
  uint32_t sighting_count = 0;
};

/// A keyframe that saw a point, and how.
struct KeyframeSighting {
  const Sighting* sighting = nullptr;
  std::array<const Descriptor*, 2> descriptors{};  ///< Sighting::descriptions of them
};

struct ProjectedPoints {
  std::vector<ProjectedPoint> points;  ///< ascending by id
  std::vector<KeyframeSighting> sightings;
  [[nodiscard]] std::span<const KeyframeSighting> sightings_of(const ProjectedPoint& p) const {
    return std::span(sightings).subspan(p.first_sighting, p.sighting_count);
  }
};
/// Projects the points that some keyframes of the map (indices) have described, as they look in an image of
/// which a share is `white`, and keeps those in the image. Of all points, in the order of ids, only each
/// `every`-th is looked at. `out` keeps its memory.
void project_points(const Camera& camera, const SE3& camera_from_map, const IndexedMap& map,
                    std::span<const size_t> keyframes, float white, ProjectedPoints* out, size_t every = 1);

/// Matches of projected points with corners within `radius` px of the corner's level, at most a level from
/// one at which the point was measured. Each corner and each point at most once, in the order of corners.
struct GuidedMatches {
  std::vector<PlaceMatch> matches;
  /// Number of matches that there could be if all were alike: corners on which a point of about their level
  /// falls, or points that fall on one, whichever are fewer.
  size_t met = 0;
};
[[nodiscard]] GuidedMatches match_near(const PlaceView& view, const CornerGrid& grid,
                                       const ProjectedPoints& projected, double radius,
                                       const MatchOptions& options);

/// Keeps the matches that moved from the keyframe's image to the query's as at least
/// MatchOptions::fewest_supporters of their neighbours did (the idea of grid-based motion statistics: Bian et
/// al., CVPR 2017). Of false matches few do, by chance: sampling from these finds a pose in tens of trials
/// where sampling from all needs thousands. In the given order.
[[nodiscard]] std::vector<PlaceMatch> keep_supported(const PlaceView& view,
                                                     std::span<const PlaceMatch> matches,
                                                     const MatchOptions& options);

/// Turns matches into observations of a pose, with sigma 2^level px.
[[nodiscard]] std::vector<PointObservation> to_observations(const PlaceView& view,
                                                            std::span<const PlaceMatch> matches);

}  // namespace cairn
