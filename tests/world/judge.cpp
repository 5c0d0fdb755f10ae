// SPDX-License-Identifier: Apache-2.0
#include "tests/world/judge.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <ranges>

#include "common/geometry/alignment.h"
#include "common/io/calibration.h"
#include "common/io/text.h"

namespace cairn {
namespace {

constexpr std::chrono::nanoseconds kSameTime = std::chrono::milliseconds(1);
constexpr int kHomeRows = 30;  // that decide a map's home, and fewer of which tell too little of a frame

/// What a frame shows and where the tracker believed to be.
struct JudgedFrame {
  Timestamp time;
  std::optional<int> shown;   ///< the place that fills most of it
  std::vector<SE3> map_from;  ///< of every place, as seen last, or first if not yet
  SE3 map_from_camera;        ///< truth
  size_t phase = 0;           ///< index
  std::optional<size_t> map;  ///< index of the map that it was tracked in
  SE3 estimate;               ///< camera in that map
  std::optional<double> off;  ///< m from the truth
  bool right = false;
};
using Rows = std::vector<const JudgedFrame*>;
/// A part of a map: its frame and scale about a place.
struct Home {
  int place = 0;
  Similarity3 home_from_map;
};
struct PoseError {
  double metres = 0;
  double degrees = 0;
};
struct JudgedWalk {
  std::vector<JudgedFrame> frames;
  std::vector<Annotation::TimedPhase> phases;  ///< places by index of the verdict
  CameraPtr camera;
};

template <typename Items, typename TimeOf>
auto find_time(Items& items, Timestamp time, TimeOf time_of) {
  const Timestamp earliest = time + -kSameTime;
  const auto found = std::ranges::lower_bound(items, earliest, {}, time_of);
  return found != items.end() && std::invoke(time_of, *found) - time <= kSameTime ? &*found : nullptr;
}

PoseError error_about(const Home& home, const JudgedFrame& frame) {
  const SE3 truth = frame.map_from[static_cast<size_t>(home.place)].inverse() * frame.map_from_camera;
  const SE3 estimate = home.home_from_map.transform_camera(frame.estimate.inverse()).inverse();
  return {(estimate.translation() - truth.translation()).norm(),
          truth.rotation().angularDistance(estimate.rotation()) * 180 / std::numbers::pi};
}

/// None where the camera moved too little.
std::optional<Home> find_home(int place, const Rows& rows) {
  std::vector<Eigen::Vector3d> estimate;
  std::vector<Eigen::Vector3d> truth;
  for (const JudgedFrame* frame : rows) {
    estimate.push_back(frame->estimate.translation());
    truth.push_back(
        (frame->map_from[static_cast<size_t>(place)].inverse() * frame->map_from_camera).translation());
  }
  const auto aligned = align_points(estimate, truth, true);
  return aligned ? std::optional(Home{place, *aligned}) : std::nullopt;
}

/// How far off the rows are, in metres: the median.
double drift_about(const Home& home, const Rows& rows) {
  std::vector<double> metres;
  for (const JudgedFrame* frame : rows) metres.push_back(error_about(home, *frame).metres);
  const auto middle = metres.begin() + static_cast<ptrdiff_t>(metres.size() / 2);
  std::nth_element(metres.begin(), middle, metres.end());
  return *middle;
}

class Judge {
 public:
  explicit Judge(MapExtent extent) : extent_(extent) {}

  Verdict run(const std::vector<WalkRecord>& walks, const std::optional<std::vector<PlacedLabel>>& labels) {
    for (const WalkRecord& walk : walks) list_places(walk.annotation);
    for (const WalkRecord& walk : walks) {
      lay_out(walk);
      enter_estimate(walk.estimate);
    }
    for (size_t map = 0; map < verdict_.maps.size(); ++map) judge_map(map);
    for (const JudgedWalk& walk : walks_) {
      judge_visits(walk);
      list_wrong_locks(walk);
    }
    for (const WalkRecord& walk : walks) {
      for (const LabelTruth& thing : walk.things) {
        if (labels) judge_label(thing, *labels);
      }
    }
    return std::move(verdict_);
  }

 private:
  int place_named(const std::string& name) {
    const auto found = std::ranges::find(verdict_.places, name, &RelocalizationVerdict::name);
    if (found == verdict_.places.end()) verdict_.places.push_back({name, false, 0, {}});
    return static_cast<int>(std::ranges::find(verdict_.places, name, &RelocalizationVerdict::name) -
                            verdict_.places.begin());
  }

  void list_places(const Annotation& annotation) {
    for (size_t i = 0; i < annotation.places.size(); ++i) {
      const int place = place_named(annotation.places[i]);
      if (annotation.mapped(static_cast<int>(i))) verdict_.places[static_cast<size_t>(place)].to_map = true;
    }
  }

  /// Frames that have a truth, with what they show.
  void lay_out(const WalkRecord& record) {
    const Annotation& annotation = record.annotation;
    std::vector<int> known;
    for (const std::string& name : annotation.places) known.push_back(place_named(name));
    JudgedWalk walk;
    walk.phases = annotation.phases;
    walk.camera = record.camera;
    for (Annotation::TimedPhase& phase : walk.phases) phase.place = known[static_cast<size_t>(phase.place)];
    map_from_.resize(verdict_.places.size());
    // Before it is seen, a place is where it is seen first.
    for (const Annotation::Frame& frame : std::views::reverse(annotation.frames)) see(frame, known);
    size_t phase = 0;
    for (const Annotation::Frame& frame : annotation.frames) {
      see(frame, known);
      while (phase + 1 < walk.phases.size() && frame.time >= walk.phases[phase].end) ++phase;
      const StampedPose* truth = find_time(record.truth, frame.time, &StampedPose::time);
      if (truth == nullptr) continue;
      JudgedFrame judged;
      judged.time = frame.time;
      if (!frame.shares.empty()) judged.shown = known[static_cast<size_t>(frame.shares.front().place)];
      judged.map_from = map_from_;
      judged.map_from_camera = truth->map_from_camera;
      judged.phase = phase;
      walk.frames.push_back(std::move(judged));
    }
    walks_.push_back(std::move(walk));
  }

  void see(const Annotation::Frame& frame, const std::vector<int>& known) {
    for (const auto& share : frame.shares) {
      map_from_[static_cast<size_t>(known[static_cast<size_t>(share.place)])] = share.map_from_place;
    }
  }

  void enter_estimate(const Trajectory& estimate) {
    for (const TrajectorySegment& segment : estimate.segments) {
      const auto found = std::ranges::find(verdict_.maps, segment.map, &MapVerdict::id);
      const auto map = static_cast<size_t>(found - verdict_.maps.begin());
      if (found == verdict_.maps.end()) verdict_.maps.push_back({segment.map, segment.map_name, {}, {}});
      for (const StampedPose& row : segment.poses) {
        JudgedFrame* frame = find_time(walks_.back().frames, row.time, &JudgedFrame::time);
        if (frame == nullptr) continue;
        frame->map = map;
        frame->estimate = row.map_from_camera;
      }
    }
  }

  /// The map's frames in the phase in which it was begun; where these are few, in the phases after it too.
  [[nodiscard]] Rows first_frames(size_t map) const {
    Rows first;
    for (const JudgedWalk& walk : walks_) {
      for (const JudgedFrame& frame : walk.frames) {
        if (frame.map != map) continue;
        if (first.size() >= kHomeRows && frame.phase != first.back()->phase) break;
        first.push_back(&frame);
      }
      if (!first.empty()) break;
    }
    return first;
  }

  static std::optional<int> home_of(const Rows& first) {
    std::map<int, int> votes;
    for (const JudgedFrame* frame : std::span(first).first(std::min<size_t>(first.size(), kHomeRows))) {
      if (frame->shown) ++votes[*frame->shown];
    }
    const auto most = std::ranges::max_element(votes, {}, [](const auto& vote) { return vote.second; });
    return most == votes.end() ? std::nullopt : std::optional(most->first);
  }

  void judge_map(size_t map) {
    MapVerdict& verdict = verdict_.maps[map];
    const Rows first = first_frames(map);
    verdict.home = home_of(first);
    if (verdict.home) ++verdict_.places[static_cast<size_t>(*verdict.home)].maps;
    std::vector<Home> homes;
    if (const auto home = verdict.home ? find_home(*verdict.home, first) : std::nullopt) {
      homes.push_back(*home);
      verdict.homes.push_back({home->place, 0});
      if (extent_ == MapExtent::kManyPlaces) add_homes(map, &homes);
    }
    verdict.judged = !homes.empty();
    for (JudgedWalk& walk : walks_) {
      for (JudgedFrame& frame : walk.frames) {
        if (frame.map != map) continue;
        if (verdict.judged) judge_row(homes, &frame);
        ++(frame.right ? verdict.right : verdict.wrong);
      }
    }
  }

  /// The further places that are mapped in it.
  void add_homes(size_t map, std::vector<Home>* homes) {
    for (const JudgedWalk& walk : walks_) {
      for (size_t phase = 0; phase < walk.phases.size(); ++phase) {
        const int place = walk.phases[phase].place;
        if (walk.phases[phase].kind != PhaseKind::kMap || place == homes->front().place) continue;
        Rows rows;
        for (const JudgedFrame& frame : walk.frames) {
          if (frame.phase == phase && frame.map == map) rows.push_back(&frame);
        }
        if (rows.size() < kHomeRows) continue;
        const auto home = find_home(place, rows);
        const double drift = drift_about(homes->front(), rows);
        if (!home || drift > kMostDrift) continue;
        homes->push_back(*home);
        verdict_.maps[map].homes.push_back({place, drift});
        ++verdict_.places[static_cast<size_t>(place)].maps;
      }
    }
  }

  static void judge_row(const std::vector<Home>& homes, JudgedFrame* frame) {
    const auto distance = [&](const Home& home) {
      return (frame->map_from[static_cast<size_t>(home.place)].translation() -
              frame->map_from_camera.translation())
          .norm();
    };
    const PoseError off = error_about(*std::ranges::min_element(homes, {}, distance), *frame);
    frame->off = off.metres;
    frame->right = off.metres <= kRightMetres && off.degrees <= kRightDegrees;
  }

  void judge_visits(const JudgedWalk& walk) {
    for (size_t phase = 0; phase < walk.phases.size(); ++phase) {
      if (walk.phases[phase].kind != PhaseKind::kVisit) continue;
      const int place = walk.phases[phase].place;
      VisitVerdict visit;
      for (const JudgedFrame& frame : walk.frames) {
        if (frame.phase == phase) count(frame, place, &visit);
      }
      verdict_.places[static_cast<size_t>(place)].visits.push_back(visit);
    }
  }

  void count(const JudgedFrame& frame, int place, VisitVerdict* visit) const {
    ++visit->frames;
    if (!frame.map) return;
    if (!frame.right) {
      ++visit->wrong;
    } else if (is_home(verdict_.maps[*frame.map], place)) {
      if (!visit->frames_to_lock) visit->frames_to_lock = visit->frames - 1;
      ++visit->right;
    } else {
      ++visit->elsewhere;
    }
  }

  static bool is_home(const MapVerdict& map, int place) {
    return std::ranges::find(map.homes, place, &HomeVerdict::place) != map.homes.end();
  }

  void list_wrong_locks(const JudgedWalk& walk) {
    const JudgedFrame* before = nullptr;
    for (const JudgedFrame& frame : walk.frames) {
      if (frame.map && !frame.right) {
        const bool same_map = before != nullptr && before->map == frame.map;
        if (!same_map || before->right) {
          const MapVerdict& map = verdict_.maps[*frame.map];
          verdict_.wrong_locks.push_back({map.id, map.name, frame.shown, frame.time,
                                          static_cast<int>(&walk - walks_.data()), 0, frame.off.value_or(0),
                                          false, same_map});
        }
        WrongLock& lock = verdict_.wrong_locks.back();
        ++lock.frames;
        lock.at_unmapped |= visits_unmapped(walk.phases[frame.phase]);
      }
      before = &frame;
    }
  }

  [[nodiscard]] bool visits_unmapped(const Annotation::TimedPhase& phase) const {
    return phase.kind == PhaseKind::kVisit && !verdict_.places[static_cast<size_t>(phase.place)].to_map;
  }

  void judge_label(const LabelTruth& thing, const std::vector<PlacedLabel>& labels) {
    LabelVerdict verdict{place_named(thing.place), false, {}};
    for (const PlacedLabel& label : labels) {
      const auto map = std::ranges::find(verdict_.maps, label.map, &MapVerdict::name);
      if (label.text != thing.place || map == verdict_.maps.end()) continue;
      if (map->home != verdict.place && !is_home(*map, verdict.place)) continue;
      verdict.placed = true;
      const auto index = static_cast<size_t>(map - verdict_.maps.begin());
      for (const JudgedWalk& walk : walks_) look_for(label, index, thing, walk, &verdict);
    }
    std::ranges::sort(verdict.degrees);
    verdict_.labels.push_back(std::move(verdict));
  }

  static void look_for(const PlacedLabel& label, size_t map, const LabelTruth& thing, const JudgedWalk& walk,
                       LabelVerdict* verdict) {
    for (const JudgedFrame& frame : walk.frames) {
      if (walk.phases[frame.phase].kind != PhaseKind::kVisit || frame.map != map || !frame.right) continue;
      const SE3& map_from_place = frame.map_from[static_cast<size_t>(verdict->place)];
      const Eigen::Vector3d truth = frame.map_from_camera.inverse() * (map_from_place * thing.point);
      const auto pixel = walk.camera->project(truth);
      if (!pixel || !walk.camera->in_image(*pixel)) continue;
      const Eigen::Vector3d shown = frame.estimate.inverse() * label.position;
      verdict->degrees.push_back(std::atan2(truth.cross(shown).norm(), truth.dot(shown)) * 180 /
                                 std::numbers::pi);
    }
  }

  const MapExtent extent_;
  Verdict verdict_;
  std::vector<SE3> map_from_;  ///< of every place, as last seen, also in an earlier walk
  std::vector<JudgedWalk> walks_;
};

}  // namespace

Result<WalkRecord> read_walk(const std::filesystem::path& recording,
                             const std::filesystem::path& trajectory) {
  auto annotation = read_annotation(recording);
  if (!annotation) return tl::unexpected(annotation.error());
  auto truth = read_trajectory(recording / "groundtruth.txt");
  if (!truth) return tl::unexpected(truth.error());
  const auto content = read_text_file(trajectory);
  if (!content) return tl::unexpected(content.error());
  Result<Trajectory> estimate;
  if (!data_lines(*content).empty()) estimate = read_trajectory(trajectory);
  if (!estimate) return tl::unexpected(estimate.error());
  const auto camera = read_calibration(recording / "camera.txt").and_then(make_camera);
  if (!camera) return tl::unexpected(camera.error());
  auto things = read_label_truth(recording);
  if (!things) return tl::unexpected(things.error());
  return WalkRecord{std::move(*annotation), std::move(truth->segments.front().poses), std::move(*estimate),
                    *camera, std::move(*things)};
}

int Verdict::places_to_map() const {
  return static_cast<int>(std::ranges::count(places, true, &RelocalizationVerdict::to_map));
}

int Verdict::places_mapped() const {
  return static_cast<int>(
      std::ranges::count_if(places, [](const RelocalizationVerdict& p) { return p.to_map && p.maps > 0; }));
}

int Verdict::places_found() const {
  return static_cast<int>(std::ranges::count_if(places, [](const RelocalizationVerdict& place) {
    return place.to_map && !place.visits.empty() &&
           std::ranges::all_of(place.visits,
                               [](const VisitVerdict& v) { return v.frames_to_lock.has_value(); });
  }));
}

int Verdict::locks_at_unmapped() const {
  return static_cast<int>(std::ranges::count(wrong_locks, true, &WrongLock::at_unmapped));
}

int Verdict::locks_excused() const {
  return static_cast<int>(std::ranges::count_if(wrong_locks, &WrongLock::excused));
}

int Verdict::labels_placed() const {
  return static_cast<int>(std::ranges::count(labels, true, &LabelVerdict::placed));
}

bool Verdict::passes() const {
  return places_mapped() == places_to_map() && places_found() == places_to_map() &&
         std::ranges::all_of(wrong_locks, &WrongLock::excused);
}

Verdict judge(const std::vector<WalkRecord>& walks, MapExtent extent,
              const std::optional<std::vector<PlacedLabel>>& labels) {
  return Judge(extent).run(walks, labels);
}

}  // namespace cairn
