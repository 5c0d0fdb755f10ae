// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/io/trajectory.h"
#include "tests/world/annotation.h"
#include "tests/world/labels.h"

namespace cairn {

/// One walk of the wearer: what there was to see, and what a tracker made of it.
struct WalkRecord {
  Annotation annotation;
  std::vector<StampedPose> truth;  ///< camera in the simulator's map, in order of time
  Trajectory estimate;             ///< rows `# map ID NAME`
  CameraPtr camera;
  std::vector<LabelTruth> things;  ///< that were labelled
};

/// `places.txt`, `phases.txt`, `groundtruth.txt`, `camera.txt` and `label_truth.txt` of a recording, and a
/// trajectory, which may be empty. Errors as their readers'.
[[nodiscard]] Result<WalkRecord> read_walk(const std::filesystem::path& recording,
                                           const std::filesystem::path& trajectory);

/// A pose counts as right within these of the truth: a live map is off by centimetres, a wrong place by
/// metres.
constexpr double kRightMetres = 0.15;
constexpr double kRightDegrees = 10;

/// Half a second: a pose that was right may be held so long after the camera has left the map or a part of it
/// has moved. Longer, and the map glides along.
constexpr int kMostHeldFrames = 15;

/// A place whose part of a map has moved further than this is not a part of it.
constexpr double kMostDrift = 0.5;

/// How many places a map may be the map of.
enum class MapExtent : uint8_t {
  kOnePlace,
  kManyPlaces,  ///< of every place in whose phase kMap it was tracked for a second at least
};

/// What a map is the map of. Its frame and scale there are found from the rows of the phase.
struct HomeVerdict {
  int place = 0;
  double drift = 0;  ///< [m] of the phase's poses by the first home's frame and scale: median; 0 of the first
};

/// A map by its home, the place that it was begun at. Its frame and scale are found from the rows of the
/// phase in which it was begun; a later row is right if, moved by the same similarity, it agrees with the
/// truth about the home, wherever the home has moved since. Of several homes, the one nearest to the camera
/// counts.
struct MapVerdict {
  MapId id;
  std::string name;
  std::optional<int> home;         ///< none if no place was in view
  std::vector<HomeVerdict> homes;  ///< `home` first, if judged; more of kManyPlaces only
  bool judged = false;  ///< false without a home, or where the camera moved too little to find the frame
  int right = 0;        ///< rows
  int wrong = 0;        ///< rows, also all of a map that cannot be judged
};

struct VisitVerdict {
  int frames = 0;
  int right = 0;                      ///< frames tracked in a map of the place
  int elsewhere = 0;                  ///< frames tracked rightly in another place's map
  int wrong = 0;                      ///< frames with a wrong pose
  std::optional<int> frames_to_lock;  ///< before the first that is right, in a map of the place
};

struct RelocalizationVerdict {
  std::string name;
  bool to_map = false;  ///< it has a phase kMap
  int maps = 0;         ///< that have a home here
  std::vector<VisitVerdict> visits;
};

/// The label of a thing, in a map of its place.
struct LabelVerdict {
  int place = 0;
  bool placed = false;
  /// Between where the label appears and where the thing is, from the camera: of each frame of a visit that
  /// was tracked rightly in that map and has the thing within its image. Ascending.
  std::vector<double> degrees;
};

/// Consecutive frames with a wrong pose in one map.
struct WrongLock {
  MapId map;
  std::string map_name;
  std::optional<int> shown;  ///< the place that fills most of the first frame
  Timestamp begin;
  int walk = 0;  ///< index
  int frames = 0;
  double metres = 0;         ///< off the truth at first; 0 in a map that cannot be judged
  bool at_unmapped = false;  ///< some of them while a place without a map was visited
  bool held = false;         ///< follows a right frame in the same map

  /// Held too long, but for moments only and at no place without a map: not taken for another place.
  [[nodiscard]] bool excused() const { return held && !at_unmapped && frames <= kMostHeldFrames; }
};

struct Verdict {
  std::vector<RelocalizationVerdict> places;
  std::vector<MapVerdict> maps;
  std::vector<WrongLock> wrong_locks;  ///< in order
  std::vector<LabelVerdict> labels;    ///< one for each thing to be labelled, where labels were asked for

  [[nodiscard]] int places_to_map() const;
  [[nodiscard]] int places_mapped() const;
  /// Places of a map's own that were found at every visit.
  [[nodiscard]] int places_found() const;
  [[nodiscard]] int locks_at_unmapped() const;
  [[nodiscard]] int locks_excused() const;
  [[nodiscard]] int labels_placed() const;
  /// Every place to map is mapped and found at every visit, and no lock is wrong but those excused.
  [[nodiscard]] bool passes() const;
};

/// Walks in order, all in one world (places are matched by name); maps carry over from one to the next.
/// `labels`: those of all maps in the end, matched by the names of map and place; nothing: not judged.
[[nodiscard]] Verdict judge(const std::vector<WalkRecord>& walks, MapExtent extent = MapExtent::kOnePlace,
                            const std::optional<std::vector<PlacedLabel>>& labels = {});

/// The verdict for people: one row a place, then the sums. And for machines: one JSON document.
[[nodiscard]] std::string verdict_text(const Verdict& verdict);
[[nodiscard]] std::string verdict_json(const Verdict& verdict);

}  // namespace cairn
