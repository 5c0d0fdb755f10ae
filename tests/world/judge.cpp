// SPDX-License-Identifier: Apache-2.0
#include "tests/world/judge.h"

#include <algorithm>
#include <map>
#include <numbers>

#include "common/geometry/alignment.h"
#include "common/io/text.h"

namespace cairn {
namespace {

constexpr std::chrono::nanoseconds kSameTime = std::chrono::milliseconds(1);
constexpr int kHomeRows = 30;  // that decide a map's home

/// What a frame shows and where the tracker believed to be.
struct JudgedFrame {
  Timestamp time;
  std::optional<int> shown;   ///< the place that fills most of it
  std::vector<SE3> map_from;  ///< of every place, as last seen
  SE3 map_from_camera;        ///< truth
  size_t phase = 0;           ///< index
  std::optional<size_t> map;  ///< index of the map that it was tracked in
  SE3 estimate;               ///< camera in that map
  std::optional<double> off;  ///< m from the truth
  bool right = false;
};
struct JudgedWalk {
  std::vector<JudgedFrame> frames;
  std::vector<Annotation::TimedPhase> phases;  ///< places by index of the verdict
};

template <typename Items, typename TimeOf>
auto find_time(Items& items, Timestamp time, TimeOf time_of) {
  const Timestamp earliest = time + -kSameTime;
  const auto found = std::ranges::lower_bound(items, earliest, {}, time_of);
  return found != items.end() && std::invoke(time_of, *found) - time <= kSameTime ? &*found : nullptr;
}

class Judge {
 public:
  Verdict run(const std::vector<WalkRecord>& walks) {
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
    return std::move(verdict_);
  }

 private:
  int place_named(const std::string& name) {
    const auto found = std::ranges::find(verdict_.places, name, &PlaceVerdict::name);
    if (found == verdict_.places.end()) verdict_.places.push_back({name, false, 0, {}});
    return static_cast<int>(std::ranges::find(verdict_.places, name, &PlaceVerdict::name) -
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
    for (Annotation::TimedPhase& phase : walk.phases) phase.place = known[static_cast<size_t>(phase.place)];
    std::vector<SE3> map_from(verdict_.places.size());
    size_t phase = 0;
    for (const Annotation::Frame& frame : annotation.frames) {
      for (const auto& share : frame.shares) {
        map_from[static_cast<size_t>(known[static_cast<size_t>(share.place)])] = share.map_from_place;
      }
      while (phase + 1 < walk.phases.size() && frame.time >= walk.phases[phase].end) ++phase;
      const StampedPose* truth = find_time(record.truth, frame.time, &StampedPose::time);
      if (truth == nullptr) continue;
      JudgedFrame judged;
      judged.time = frame.time;
      if (!frame.shares.empty()) judged.shown = known[static_cast<size_t>(frame.shares.front().place)];
      judged.map_from = map_from;
      judged.map_from_camera = truth->map_from_camera;
      judged.phase = phase;
      walk.frames.push_back(std::move(judged));
    }
    walks_.push_back(std::move(walk));
  }

  void enter_estimate(const Trajectory& estimate) {
    for (const TrajectorySegment& segment : estimate.segments) {
      const auto found = std::ranges::find(verdict_.maps, segment.map, &MapVerdict::id);
      const auto map = static_cast<size_t>(found - verdict_.maps.begin());
      if (found == verdict_.maps.end()) verdict_.maps.push_back({segment.map, segment.map_name, {}});
      for (const StampedPose& row : segment.poses) {
        JudgedFrame* frame = find_time(walks_.back().frames, row.time, &JudgedFrame::time);
        if (frame == nullptr) continue;
        frame->map = map;
        frame->estimate = row.map_from_camera;
      }
    }
  }

  /// The map's frames in the phase in which it was begun.
  [[nodiscard]] std::vector<const JudgedFrame*> first_frames(size_t map) const {
    std::vector<const JudgedFrame*> first;
    for (const JudgedWalk& walk : walks_) {
      for (const JudgedFrame& frame : walk.frames) {
        if (frame.map == map && (first.empty() || frame.phase == first.front()->phase))
          first.push_back(&frame);
      }
      if (!first.empty()) break;
    }
    return first;
  }

  static std::optional<int> home_of(const std::vector<const JudgedFrame*>& first) {
    std::map<int, int> votes;
    for (const JudgedFrame* frame : std::span(first).first(std::min<size_t>(first.size(), kHomeRows))) {
      if (frame->shown) ++votes[*frame->shown];
    }
    const auto most = std::ranges::max_element(votes, {}, [](const auto& vote) { return vote.second; });
    return most == votes.end() ? std::nullopt : std::optional(most->first);
  }

  void judge_map(size_t map) {
    MapVerdict& verdict = verdict_.maps[map];
    const auto first = first_frames(map);
    verdict.home = home_of(first);
    std::optional<Similarity3> home_from_map;
    if (verdict.home) {
      const auto home = static_cast<size_t>(*verdict.home);
      ++verdict_.places[home].maps;
      std::vector<Eigen::Vector3d> estimate;
      std::vector<Eigen::Vector3d> truth;
      for (const JudgedFrame* frame : first) {
        estimate.push_back(frame->estimate.translation());
        truth.push_back((frame->map_from[home].inverse() * frame->map_from_camera).translation());
      }
      if (const auto aligned = align_points(estimate, truth, true)) home_from_map = *aligned;
    }
    verdict.judged = home_from_map.has_value();
    for (JudgedWalk& walk : walks_) {
      for (JudgedFrame& frame : walk.frames) {
        if (frame.map != map) continue;
        if (home_from_map) judge_row(*verdict.home, *home_from_map, &frame);
        ++(frame.right ? verdict.right : verdict.wrong);
      }
    }
  }

  static void judge_row(int home, const Similarity3& home_from_map, JudgedFrame* frame) {
    const SE3 truth = frame->map_from[static_cast<size_t>(home)].inverse() * frame->map_from_camera;
    const SE3 estimate = home_from_map.transform_camera(frame->estimate.inverse()).inverse();
    frame->off = (estimate.translation() - truth.translation()).norm();
    const double degrees = truth.rotation().angularDistance(estimate.rotation()) * 180 / std::numbers::pi;
    frame->right = *frame->off <= kRightMetres && degrees <= kRightDegrees;
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
    } else if (verdict_.maps[*frame.map].home == place) {
      if (!visit->frames_to_lock) visit->frames_to_lock = visit->frames - 1;
      ++visit->right;
    } else {
      ++visit->elsewhere;
    }
  }

  void list_wrong_locks(const JudgedWalk& walk) {
    const JudgedFrame* before = nullptr;
    for (const JudgedFrame& frame : walk.frames) {
      const bool wrong = frame.map && !frame.right;
      const bool goes_on = wrong && before != nullptr && before->map == frame.map && !before->right;
      if (goes_on) {
        ++verdict_.wrong_locks.back().frames;
      } else if (wrong) {
        const bool held = before != nullptr && before->map == frame.map;
        const Annotation::TimedPhase& phase = walk.phases[frame.phase];
        const MapVerdict& map = verdict_.maps[*frame.map];
        verdict_.wrong_locks.push_back(
            {map.id, map.name, frame.shown, frame.time, static_cast<int>(&walk - walks_.data()), 1,
             frame.off.value_or(0),
             phase.kind == PhaseKind::kVisit && !verdict_.places[static_cast<size_t>(phase.place)].to_map,
             held});
      }
      before = &frame;
    }
  }

  Verdict verdict_;
  std::vector<JudgedWalk> walks_;
};

}  // namespace

Result<WalkRecord> read_walk(const std::filesystem::path& recording,
                             const std::filesystem::path& trajectory) {
  auto annotation = read_annotation(recording);
  if (!annotation) return tl::unexpected(annotation.error());
  auto truth = read_trajectory(recording / "groundtruth.txt");
  if (!truth) return tl::unexpected(truth.error());
  const auto content = read_file(trajectory);
  if (!content) return tl::unexpected(content.error());
  Result<Trajectory> estimate;
  if (!data_lines(*content).empty()) estimate = read_trajectory(trajectory);
  if (!estimate) return tl::unexpected(estimate.error());
  return WalkRecord{std::move(*annotation), std::move(truth->segments.front().poses), std::move(*estimate)};
}

int Verdict::places_to_map() const {
  return static_cast<int>(std::ranges::count(places, true, &PlaceVerdict::to_map));
}

int Verdict::places_mapped() const {
  return static_cast<int>(
      std::ranges::count_if(places, [](const PlaceVerdict& p) { return p.to_map && p.maps > 0; }));
}

int Verdict::places_found() const {
  return static_cast<int>(std::ranges::count_if(places, [](const PlaceVerdict& place) {
    return place.to_map && !place.visits.empty() &&
           std::ranges::all_of(place.visits,
                               [](const VisitVerdict& v) { return v.frames_to_lock.has_value(); });
  }));
}

int Verdict::locks_at_unmapped() const {
  return static_cast<int>(std::ranges::count(wrong_locks, true, &WrongLock::at_unmapped));
}

int Verdict::locks_held() const {
  return static_cast<int>(std::ranges::count(wrong_locks, true, &WrongLock::held));
}

bool Verdict::passes() const {
  return places_mapped() == places_to_map() && places_found() == places_to_map() && wrong_locks.empty();
}

Verdict judge(const std::vector<WalkRecord>& walks) {
  return Judge().run(walks);
}

}  // namespace cairn
