// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/tracker.h"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "client/tracking/frame_images.h"
#include "client/tracking/motion.h"
#include "client/tracking/point_search.h"
#include "client/tracking/recovery.h"
#include "client/tracking/trails.h"
#include "common/geometry/pose.h"

namespace cairn {
namespace {

constexpr int kCoarseLevel = 2;       // the coarse stage uses the two top levels (ptam.md 5)
constexpr int kCoarseAvailable = 20;  // ptam.md 5: fewer and the coarse stage is left out
constexpr int kCoarseFound = 12;      // fewer and its pose is not believed (PTAM: 20 of 60)
constexpr int kRefineIterations = 8;  // ptam.md 5
constexpr int kLargeAttempted = 10;   // ptam.md 8
constexpr int kFewestFound = 15;      // inliers below which no pose is believed
constexpr int kEnoughForKeyframe =
    80;  // points found: the pose is sound although most of the map is out of sight
constexpr int kFewestRecovered = 25;  // and after a loss
constexpr float kRecoveredQuality = 0.4F;
constexpr int kProofFrames = 3;               // in a row, for a pose that was found by trying keyframes
constexpr size_t kKeyframesTried = 3;         // in a frame
constexpr size_t kTriesBeforeKeyframes = 30;  // frames in which the places remembered did not help
constexpr double kLookAside = 0.12;           // [rad] between successive rounds over the keyframes
constexpr int kFewestFromTrails = 20;
constexpr double kMinSquaredCutoff =
    1.0;  // Tukey's, in units of sigma: sub-pixel matches at level 0 are good to 0.3 px
// Where half of the matches are false (stripes, tiles, blur), their median is no measure of the noise, and a
// cut-off from it lets them bend the pose by centimetres. A map that does not fit so well is tracked by the
// second attempt, which has no ceiling.
constexpr double kMaxSquaredCutoff = 9.0;
constexpr float kWiden = 2.0F;  // second attempt, recovery: ptam.md 5 doubles points and radius

class ScopedStage {
 public:
  ScopedStage(StageProbe* probe, Stage stage) : probe_(probe), stage_(stage) {
    if (probe_ != nullptr) probe_->begin(stage_);
  }
  ~ScopedStage() {
    if (probe_ != nullptr) probe_->end(stage_);
  }
  ScopedStage(const ScopedStage&) = delete;
  ScopedStage& operator=(const ScopedStage&) = delete;

 private:
  StageProbe* probe_;
  Stage stage_;
};

enum class Verdict : uint8_t { kGood, kPoor, kBad };

}  // namespace

const char* to_string(Stage stage) {
  constexpr std::array<const char*, static_cast<size_t>(Stage::kCount)> kNames = {
      "pyramid", "corners", "prior", "project", "coarse", "fine", "pose", "trails", "recover"};
  return kNames[static_cast<size_t>(stage)];
}

struct Tracker::State {
  State(const CameraPtr& camera_in, const TrackerOptions& options_in)
      : camera(camera_in), options(options_in), trails(camera_in, options_in), search(camera_in) {}

  CameraPtr camera;
  TrackerOptions options;
  TrailFollower trails;
  PointSearch search;
  PlaceMemory places;
  MotionModel model;

  std::array<FrameImages, 2> frames;
  size_t current = 0;
  bool has_previous = false;
  TinyMotion seen;  ///< how the tiny image moved since the previous frame

  bool starting = true;
  std::optional<SeedAnswer> awaited;
  MapSnapshotPtr map;
  KeyframeId reference;  ///< keyframe nearest to the last measured pose, and the pose relative to it
  SE3 camera_from_reference;
  double mean_depth = 1;
  int bad_frames = 0;
  size_t lost_frames = 0;
  int since_keyframe = 0;
  int most_found = 0;  ///< points found in a frame since the last keyframe was proposed
  int unproven = 0;    ///< frames that must still confirm the pose before it is reported
  size_t keyframes_tried = 0;

  std::vector<VisiblePoint> visible;
  std::vector<PointObservation> observations;
  std::vector<size_t> observed;  ///< index into visible of each observation
  FrameResult result;
  StageProbe* probe = nullptr;

  FrameImages& now() { return frames[current]; }
  FrameImages& previous() { return frames[1 - current]; }

  void prepare(const GrayImagePtr& image);
  void clear_result();
  void follow_trails(const GrayImagePtr& image, Timestamp time);
  void begin_map(const MapSnapshotPtr& snapshot, Timestamp time);
  [[nodiscard]] std::optional<SE3> pose_from_trails(const MapSnapshot& snapshot);
  void adopt_revision(const MapSnapshotPtr& snapshot);

  struct Effort {
    int coarse_points;
    float coarse_radius;
    float fine_radius;
    float fine_radius_after_coarse;
    double max_squared_cutoff;  ///< of the pose's M-estimator, in units of sigma
    bool needs_coarse = false;  ///< gives up when the coarse stage, which is cheap, finds no pose
  };
  [[nodiscard]] Effort normal_effort() const;
  [[nodiscard]] Effort wide_effort() const;
  [[nodiscard]] std::optional<SE3> coarse_stage(const SE3& start, const Effort& effort);
  [[nodiscard]] std::optional<SE3> fine_stage(const SE3& start, const Effort& effort, float radius);
  [[nodiscard]] std::optional<SE3> locate(const SE3& start, const Effort& effort);
  [[nodiscard]] std::optional<SE3> solve(const SE3& start, double max_squared_cutoff);
  [[nodiscard]] Verdict judge() const;

  void track_map(Timestamp time);
  void recover(Timestamp time);
  [[nodiscard]] bool found_from(const SE3& start, const Effort& effort, Timestamp time);
  void look_from_keyframes(Timestamp time);
  void join_map(const MapSnapshotPtr& snapshot);
  [[nodiscard]] bool is_sure() const {
    return result.found >= kFewestRecovered && result.quality >= kRecoveredQuality;
  }
  void accept(const SE3& camera_from_map, Timestamp time, Verdict verdict);
  void propose_keyframe();
  void report_points();
};

void Tracker::State::clear_result() {
  std::vector<TrackedPoint> points = std::move(result.points);
  std::vector<TrailLine> lines = std::move(result.trails);
  result = FrameResult{};
  points.clear();
  lines.clear();
  result.points = std::move(points);
  result.trails = std::move(lines);
}

void Tracker::State::prepare(const GrayImagePtr& image) {
  current = 1 - current;
  {
    const ScopedStage stage(probe, Stage::kPyramid);
    now().build_pyramid(image->view());
  }
  {
    const ScopedStage stage(probe, Stage::kCorners);
    now().find_corners();
  }
  const ScopedStage stage(probe, Stage::kPrior);
  now().build_tiny();
  seen = has_previous ? align_tiny(previous().tiny, now().tiny) : TinyMotion{};
}

void Tracker::State::follow_trails(const GrayImagePtr& image, Timestamp time) {
  const ScopedStage stage(probe, Stage::kTrails);
  if (!options.make_maps && !awaited) {
    result.note = "no map to track in yet";
    return;
  }
  trails.follow(image, time, now(), previous(), seen);
  if (options.make_maps && !awaited) result.seed = trails.propose(image, time, now());
  trails.lines(&result.trails);
  result.note = trails.note();
}

std::optional<SE3> Tracker::State::pose_from_trails(const MapSnapshot& snapshot) {
  const KeyframePose* second = snapshot.find(awaited->second_keyframe);
  if (second == nullptr) return std::nullopt;
  std::vector<std::pair<TrailId, PointId>> points = awaited->points;
  std::sort(points.begin(), points.end());
  observations.clear();
  for (const TrailFollower::Live& trail : trails.live()) {
    const auto match = std::lower_bound(points.begin(), points.end(), std::pair(trail.id, PointId{}));
    if (match == points.end() || match->first != trail.id) continue;
    const auto slot = snapshot.find(match->second);
    if (!slot) continue;
    const PointBlock& block = *snapshot.point_blocks[static_cast<size_t>(slot->block)];
    observations.push_back({block.position(slot->slot), trail.now.cast<double>(), 1.0});
  }
  if (observations.size() < kFewestFromTrails) return std::nullopt;
  const auto near = optimize_pose(*camera, second->camera_from_map, observations);
  if (near && near->inliers >= static_cast<int>(observations.size()) / 2) return near->camera_from_map;
  PoseRansacOptions ransac;
  ransac.min_inliers = kFewestFromTrails;
  ransac.seed = options.seed;
  const auto anywhere = ransac_pose(*camera, observations, ransac);
  if (!anywhere) return std::nullopt;
  return anywhere->camera_from_map;
}

void Tracker::State::begin_map(const MapSnapshotPtr& snapshot, Timestamp time) {
  const auto pose = pose_from_trails(*snapshot);
  adopt_revision(snapshot);
  if (const KeyframePose* second = map->find(awaited->second_keyframe)) {
    reference = second->id;
    camera_from_reference = SE3();
    if (second->mean_depth > 0) mean_depth = second->mean_depth;
    model.reset(pose.value_or(second->camera_from_map), time);
  }
  seen = TinyMotion{};  // the trails' pose is of this frame already
  if (!pose) bad_frames = options.lost_after_bad_frames;
  starting = false;
  most_found = 0;
  awaited.reset();
  trails.restart();
  result.trails.clear();
  result.note.clear();
}

/// A map that others made: nothing is known of where the camera is in it.
void Tracker::State::join_map(const MapSnapshotPtr& snapshot) {
  adopt_revision(snapshot);
  bad_frames = options.lost_after_bad_frames;
  starting = false;
  most_found = 0;
  trails.restart();
  result.trails.clear();
  result.note.clear();
}

void Tracker::State::adopt_revision(const MapSnapshotPtr& snapshot) {
  if (map == snapshot) return;
  const bool same = map && map->map == snapshot->map && map->epoch == snapshot->epoch;
  if (map && map->map != snapshot->map) {
    bad_frames = options.lost_after_bad_frames;
    unproven = 0;
    reference = {};
  }
  if (!same) places.clear();
  map = snapshot;
  search.use_map(map);
  if (!same) return;
  if (const KeyframePose* moved = map->find(reference)) {
    model.rebase(camera_from_reference * moved->camera_from_map);
  }
}

Tracker::State::Effort Tracker::State::normal_effort() const {
  return {options.coarse_points, options.coarse_radius, options.fine_radius, options.fine_radius_after_coarse,
          kMaxSquaredCutoff};
}

Tracker::State::Effort Tracker::State::wide_effort() const {
  return {2 * options.coarse_points, kWiden * options.coarse_radius, kWiden * options.fine_radius,
          options.fine_radius, std::numeric_limits<double>::infinity()};
}

std::optional<SE3> Tracker::State::solve(const SE3& start, double max_squared_cutoff) {
  const ScopedStage stage(probe, Stage::kPose);
  observations.clear();
  observed.clear();
  for (size_t i = 0; i < visible.size(); ++i) {
    const VisiblePoint& p = visible[i];
    if (!p.found) continue;
    observations.push_back({p.position, p.pixel.cast<double>(), static_cast<double>(1 << p.level)});
    observed.push_back(i);
  }
  PoseOptions pose_options;
  pose_options.min_squared_cutoff = kMinSquaredCutoff;
  pose_options.max_squared_cutoff = max_squared_cutoff;
  const auto estimate = optimize_pose(*camera, start, observations, pose_options);
  if (!estimate) return std::nullopt;
  result.found = estimate->inliers;
  result.reprojection_rms = estimate->rms;
  // Only what agrees with the pose counts as found.
  for (size_t i = 0; i < observed.size(); ++i) visible[observed[i]].found = estimate->weights[i] > 0;
  return estimate->camera_from_map;
}

std::optional<SE3> Tracker::State::coarse_stage(const SE3& start, const Effort& effort) {
  const auto coarse_end = std::find_if(visible.begin(), visible.end(),
                                       [](const VisiblePoint& p) { return p.level < kCoarseLevel; });
  if (coarse_end - visible.begin() < kCoarseAvailable) return std::nullopt;
  int found = 0;
  {
    const ScopedStage stage(probe, Stage::kCoarse);
    const auto count = std::min<ptrdiff_t>(coarse_end - visible.begin(), effort.coarse_points);
    for (auto p = visible.begin(); p != visible.begin() + count; ++p) {
      search.search(now(), effort.coarse_radius, kRefineIterations, &*p);
      found += p->found ? 1 : 0;
    }
  }
  if (found < kCoarseFound) return std::nullopt;
  auto pose = solve(start, effort.max_squared_cutoff);
  if (!pose || result.found < kCoarseFound) return std::nullopt;
  return pose;
}

std::optional<SE3> Tracker::State::fine_stage(const SE3& start, const Effort& effort, float radius) {
  {
    const ScopedStage stage(probe, Stage::kFine);
    std::erase_if(visible, [&](VisiblePoint& p) { return !p.found && !search.reproject(start, &p); });
    for (VisiblePoint& p : visible) {
      // A coarse point that was not found is looked for again where the coarse pose puts it.
      if (!p.found) search.search(now(), radius, kRefineIterations, &p);
    }
  }
  return solve(start, effort.max_squared_cutoff);
}

std::optional<SE3> Tracker::State::locate(const SE3& start, const Effort& effort) {
  {
    const ScopedStage stage(probe, Stage::kProject);
    search.find_visible(start, options.max_points, &visible);
  }
  result.found = 0;
  const auto coarse = coarse_stage(start, effort);
  if (!coarse) {
    for (VisiblePoint& p : visible) p.found = false;
    if (effort.needs_coarse) {
      result.found = 0;
      return std::nullopt;
    }
  }
  const auto pose = fine_stage(coarse.value_or(start), effort,
                               coarse ? effort.fine_radius_after_coarse : effort.fine_radius);
  result.attempted = static_cast<int>(visible.size());
  result.quality =
      visible.empty() ? 0 : static_cast<float>(result.found) / static_cast<float>(visible.size());
  if (!pose) result.found = 0;
  return pose;
}

Verdict Tracker::State::judge() const {
  if (result.found < kFewestFound) return Verdict::kBad;
  if (result.quality > options.good_quality) return Verdict::kGood;
  int large = 0;
  int large_found = 0;
  for (const VisiblePoint& p : visible) {
    if (p.level < kCoarseLevel) continue;
    ++large;
    large_found += p.found ? 1 : 0;
  }
  const float share =
      large > kLargeAttempted ? static_cast<float>(large_found) / static_cast<float>(large) : result.quality;
  return share < options.lost_quality ? Verdict::kBad : Verdict::kPoor;
}

void Tracker::State::accept(const SE3& camera_from_map, Timestamp time, Verdict verdict) {
  model.measured(camera_from_map, time);
  bad_frames = 0;
  lost_frames = 0;
  double depth_sum = 0;
  int count = 0;
  for (const VisiblePoint& p : visible) {
    if (!p.found) continue;
    depth_sum += p.depth;
    ++count;
  }
  if (count > 0) mean_depth = depth_sum / count;
  if (const KeyframePose* nearest = map->nearest_keyframe(camera_from_map.center())) {
    reference = nearest->id;
    camera_from_reference = camera_from_map * nearest->camera_from_map.inverse();
  }
  if (unproven > 0 && --unproven > 0) {
    result.state = TrackingState::kLost;
    result.note = "lost: proving a pose found from a keyframe";
    return;
  }
  result.state = verdict == Verdict::kGood ? TrackingState::kTracking : TrackingState::kPoor;
  result.note.clear();
  result.pose_measured = true;
  result.mean_depth = mean_depth;
  if (verdict == Verdict::kGood) places.remember(now(), reference, camera_from_reference, mean_depth);
  if (options.make_keyframes && (verdict == Verdict::kGood || result.found >= kEnoughForKeyframe))
    propose_keyframe();
}

void Tracker::State::propose_keyframe() {
  const KeyframePose* nearest = map->find(reference);
  if (nearest == nullptr) return;
  // A view of which the map knows less and less needs a keyframe sooner: what is new in it must become points
  // while the camera can still be placed by the old ones.
  most_found = std::max(most_found, result.found);
  const bool in_need =
      static_cast<float>(result.found) < options.running_out * static_cast<float>(most_found);
  const double distance = camera_from_reference.center().norm() / mean_depth;
  if (distance < options.keyframe_distance * (in_need ? options.need_distance : 1.0)) return;
  // Far beyond the limit the wait between offers shortens: a camera that moves fast would run out of its map.
  const double wait =
      in_need ? 0.25 * options.frames_between_keyframes
              : options.frames_between_keyframes * std::max(0.25, options.keyframe_distance / distance);
  if (since_keyframe < wait) return;
  KeyframeProposal proposal{map->map, map->epoch, map->revision, reference, camera_from_reference, {}};
  for (const VisiblePoint& p : visible) {
    if (p.found) proposal.measurements.push_back({p.id, p.level, p.pixel});
  }
  result.keyframe = std::move(proposal);
  since_keyframe = 0;
  most_found = result.found;
}

void Tracker::State::track_map(Timestamp time) {
  const SE3 step = correct_step(model.predicted_step(time), seen, *camera, mean_depth);
  auto pose = locate(step * model.last(), normal_effort());
  Verdict verdict = pose ? judge() : Verdict::kBad;
  if (verdict == Verdict::kBad) {
    const SE3 turn = correct_step(SE3(), seen, *camera, mean_depth);
    pose = locate(turn * model.last(), wide_effort());
    verdict = pose ? judge() : Verdict::kBad;
  }
  const bool is_refuted = unproven > 0 && !(pose && is_sure());
  if (verdict != Verdict::kBad && !is_refuted) {
    accept(*pose, time, verdict);
    return;
  }
  model.missed();
  ++bad_frames;
  if (is_refuted) {
    unproven = 0;
    bad_frames = options.lost_after_bad_frames;
  }
  result.state = TrackingState::kLost;
  result.note = fmt::format("{} of {} points found", result.found, result.attempted);
}

void Tracker::State::recover(Timestamp time) {
  const ScopedStage stage(probe, Stage::kRecover);
  constexpr size_t kCandidates = 3;
  result.state = TrackingState::kLost;
  result.note = "lost: looking where it was before";
  std::vector<SE3> starts;
  if (const KeyframePose* keyframe = map->find(reference)) {
    starts.push_back(camera_from_reference * keyframe->camera_from_map);
  }
  if (const auto place = places.recall(now(), *camera, lost_frames % kCandidates)) {
    if (const KeyframePose* keyframe = map->find(place->reference)) {
      starts.insert(starts.begin(), place->camera_from_reference * keyframe->camera_from_map);
    }
  }
  ++lost_frames;
  for (const SE3& start : starts) {
    if (found_from(start, wide_effort(), time)) return;
  }
  if (places.size() == 0 || lost_frames > kTriesBeforeKeyframes) look_from_keyframes(time);
}

/// Whether the camera is found near `start`; it is followed from there on.
bool Tracker::State::found_from(const SE3& start, const Effort& effort, Timestamp time) {
  const auto pose = locate(start, effort);
  if (!pose || !is_sure()) return false;
  model.reset(*pose, time);
  accept(*pose, time, Verdict::kGood);
  return true;
}

/// For a camera of which nothing is remembered: a few keyframes a frame, round after round, each round turned
/// another way, since a camera that stands still would never come nearer to a keyframe's direction. Whoever
/// looks everywhere finds something somewhere: such a pose has to be proven.
void Tracker::State::look_from_keyframes(Timestamp time) {
  result.note = "lost: looking from the map's keyframes";
  std::vector<const KeyframePose*> keyframes;
  for (const auto& block : map->keyframe_blocks) {
    for (size_t slot = 0; slot < block->keyframes.size(); ++slot) {
      if ((block->live >> slot & 1) != 0) keyframes.push_back(&block->keyframes[slot]);
    }
  }
  static const std::array<Eigen::Vector3d, 5> kTurns = {Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitY(),
                                                        -Eigen::Vector3d::UnitY(), Eigen::Vector3d::UnitX(),
                                                        -Eigen::Vector3d::UnitX()};
  Effort effort = wide_effort();
  effort.needs_coarse = true;
  for (size_t i = 0; i < std::min(kKeyframesTried, keyframes.size()); ++i, ++keyframes_tried) {
    const SE3& pose = keyframes[keyframes_tried % keyframes.size()]->camera_from_map;
    const Eigen::Vector3d turn = kLookAside * kTurns[keyframes_tried / keyframes.size() % kTurns.size()];
    unproven = kProofFrames;
    if (found_from(SE3(so3_exp(turn), Eigen::Vector3d::Zero()) * pose, effort, time)) return;
  }
  unproven = 0;
}

void Tracker::State::report_points() {
  for (const VisiblePoint& p : visible) {
    result.points.push_back({p.id, p.level, p.found, p.found ? p.pixel : p.expected});
  }
}

Tracker::Tracker(CameraPtr camera, const TrackerOptions& options)
    : state_(std::make_unique<State>(std::move(camera), options)) {}
Tracker::~Tracker() = default;

const FrameResult& Tracker::track(const GrayImagePtr& image, Timestamp time, const MapSnapshotPtr& map,
                                  StageProbe* probe) {
  State& s = *state_;
  s.probe = probe;
  s.clear_result();
  s.visible.clear();
  ++s.since_keyframe;
  s.prepare(image);

  if (s.starting) {
    s.follow_trails(image, time);
    if (map && s.awaited && map->map == s.awaited->map) {
      s.begin_map(map, time);
    } else if (map && !s.awaited) {
      s.join_map(map);
    }
  }
  if (!s.starting && map) {
    s.adopt_revision(map);
    if (s.bad_frames < s.options.lost_after_bad_frames) {
      s.track_map(time);
    } else {
      s.recover(time);
    }
    s.result.map = map->map;
    s.result.epoch = map->epoch;
    s.result.revision = map->revision;
    s.report_points();
  }
  s.result.camera_from_map = s.model.last();
  s.has_previous = true;
  return s.result;
}

void Tracker::use_camera(const CameraPtr& camera) {
  State& s = *state_;
  s.camera = camera;
  s.trails.use_camera(camera);
  s.search.use_camera(camera);
}

void Tracker::seed_accepted(const SeedAnswer& answer) {
  state_->awaited = answer;
}

void Tracker::seed_refused(const std::string& reason) {
  state_->trails.refused(reason);
}

void Tracker::start_over() {
  State& s = *state_;
  s.starting = true;
  s.awaited.reset();
  s.trails.restart();
  s.places.clear();
  s.map.reset();
  s.bad_frames = 0;
  s.lost_frames = 0;
  s.unproven = 0;
  s.keyframes_tried = 0;
}

}  // namespace cairn
