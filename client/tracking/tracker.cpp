// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/tracker.h"

#include <fmt/format.h>
#include <array>
#include <span>
#include <utility>

#include "client/relocalization/recovery.h"
#include "client/tracking/dead_reckoning.h"
#include "client/tracking/evidence.h"
#include "client/tracking/exposure.h"
#include "client/tracking/flow_prior.h"
#include "client/tracking/gyro_prior.h"
#include "client/tracking/keyframe_policy.h"
#include "client/tracking/local_map.h"
#include "client/tracking/map_growth.h"
#include "client/tracking/motion.h"
#include "client/tracking/pose_finder.h"
#include "client/tracking/provisional_points.h"
#include "client/tracking/still_regions.h"
#include "client/tracking/trail_pose.h"
#include "client/tracking/trails.h"
#include "common/image/frame_images.h"

namespace cairn {
namespace {

RecoveryOptions recovery_options(const TrackerOptions& options) {
  RecoveryOptions recovery = options.recovery;
  recovery.seed = options.seed;
  recovery.least_quality = options.lost_quality;
  return recovery;
}

}  // namespace

struct Tracker::State {
  State(const CameraPtr& camera_in, const TrackerOptions& options_in)
      : camera(camera_in),
        options(options_in),
        recovery(camera_in, recovery_options(options_in)),
        trails(camera_in, options_in.seed, options_in.trails),
        finder(camera_in, options_in),
        flow(camera_in, options_in.seed, options_in.flow),
        provisional(camera_in, options_in.provisional, options_in.judgement),
        reckoning(&provisional, options_in.reckoning, options_in.judgement),
        keyframes(options_in.keyframes),
        local(options_in.local),
        model(options_in.motion),
        gyro(options_in.gyro),
        still(options_in.still),
        exposure(options_in.exposure) {}

  CameraPtr camera;
  TrackerOptions options;
  Recovery recovery;
  TrailFollower trails;
  PoseFinder finder;
  FlowPrior flow;
  ProvisionalPoints provisional;
  DeadReckoning reckoning;
  int in_sight = 0;  ///< points of the map that the frame should show, from where it is expected
  KeyframePolicy keyframes;
  LocalMap local;
  std::vector<LocalPoint> known;               ///< of the frame, as
  std::vector<LocalMeasurement> measurements;  ///< are these
  std::vector<uint64_t> counted;               ///< points of the local map since the frame before
  uint64_t proposals = 0;
  MotionModel model;
  GyroPrior gyro;
  StillRegions still;

  std::array<FrameImages, 2> frames;
  size_t current = 0;
  bool has_previous = false;
  Timestamp frame_time;
  Exposure exposure;
  TinyMotion seen;      ///< how the tiny image moved since the previous frame
  float likeness = -1;  ///< of the small images, the motion undone
  bool is_cut = false;  ///< it has nothing in common with it

  MapSnapshotPtr map;   ///< the server's, with what the tracker has added
  AnchoredPose latest;  ///< the last pose measured
  double mean_depth = 1;
  double near_depth = 1;  ///< of what is nearest
  FrameResult result;
  StageProbe* probe = nullptr;

  FrameImages& now() { return frames[current]; }
  FrameImages& previous() { return frames[1 - current]; }
  /// Whether another map may be entered while starting: not while one's own is decided about.
  [[nodiscard]] bool may_enter() const { return !trails.is_undecided(); }

  // A frame, in this order.
  void begin_frame(const GrayImagePtr& image, Timestamp time, StageProbe* stage_probe);
  void start(const GrayImagePtr& image, Timestamp time, const MapSnapshotPtr& snapshot);
  void locate(Timestamp time, const MapSnapshotPtr& snapshot);
  void end_frame(Timestamp time);

  void clear_result();
  void follow_trails(const GrayImagePtr& image, Timestamp time);
  void enter_map(const MapSnapshotPtr& snapshot, Timestamp time);
  void begin_map(const MapSnapshotPtr& snapshot, Timestamp time);
  void adopt_revision(const MapSnapshotPtr& server_map, Timestamp time);

  /// What a search of the frame found, and how far it is to be believed.
  struct Attempt {
    std::optional<SE3> pose;
    FrameEvidence evidence;
    PoseVerdict verdict = PoseVerdict::kBad;
  };
  [[nodiscard]] Attempt attempt(const SE3& from, const SearchEffort& effort);
  [[nodiscard]] Attempt judged(Attempt found, PoseOrigin origin) const;
  [[nodiscard]] Attempt search_by_motion(Timestamp time);
  [[nodiscard]] Attempt compared_within_reach(Attempt found);
  [[nodiscard]] Attempt search_otherwise();
  [[nodiscard]] SearchEffort expected_effort() const;
  [[nodiscard]] SearchEffort effort_of(PoseStart::Reach reach) const;
  /// Since the frame before, by the small images, or by the gyro where these have nothing in common.
  [[nodiscard]] SE3 turned() const {
    return gyro.turn() && is_cut ? *gyro.turn()
                                 : correct_step(SE3(), seen, *camera, mean_depth, options.step_correction);
  }

  void track(Timestamp time);
  void look_for_camera(Timestamp time);
  [[nodiscard]] bool hold(Timestamp time);
  [[nodiscard]] bool hold_blindly();
  void claim_held(bool is_position_known);
  void measured(const SE3& camera_from_map, Timestamp time);
  void accept(const Attempt& found, Timestamp time);
  void miss(Timestamp time, std::string why);
  void publish(const Attempt& found, Timestamp time);
  void propose_keyframe(Timestamp time);
  void map_locally(Timestamp time, KeyframeProposal* proposal);
  void report_search();
  void learn_still();
};

void Tracker::State::begin_frame(const GrayImagePtr& image, Timestamp time, StageProbe* stage_probe) {
  probe = stage_probe;
  clear_result();
  finder.clear();
  keyframes.next_frame();
  current = 1 - current;
  {
    const ScopedStage stage(probe, Stage::kPyramid);
    now().build_pyramid(image->view(), still.mask());
  }
  const ScopedStage stage(probe, Stage::kPrior);
  now().build_tiny();
  seen = has_previous ? align_tiny(previous().tiny, now().tiny) : TinyMotion{};
  likeness = has_previous ? tiny_correlation(previous().tiny, now().tiny, seen) : -1;
  is_cut = has_previous && !(likeness >= options.same_view);
  // What two images without anything in common are aligned by is no motion.
  if (has_previous)
    exposure.next_frame(is_cut ? TinyMotion{} : seen, seconds_between(time, frame_time), &now());
  frame_time = time;
  gyro.next_frame(time);
}

void Tracker::State::clear_result() {
  std::vector<TrackedPoint> points = std::move(result.points);
  std::vector<TrailLine> lines = std::move(result.trails);
  result = FrameResult{};
  points.clear();
  lines.clear();
  result.points = std::move(points);
  result.trails = std::move(lines);
}

/// No map yet: trails are followed until they make one, or until one is known of the place.
void Tracker::State::start(const GrayImagePtr& image, Timestamp time, const MapSnapshotPtr& snapshot) {
  follow_trails(image, time);
  if (!snapshot) return;
  if (trails.awaited() && snapshot->map == trails.awaited()->map) {
    begin_map(snapshot, time);
  } else if (may_enter() && !recovery.insists()) {
    enter_map(snapshot, time);
  }
}

void Tracker::State::follow_trails(const GrayImagePtr& image, Timestamp time) {
  const ScopedStage stage(probe, Stage::kTrails);
  if (!options.make_maps && !trails.awaited()) {
    result.note = "looking for a map of this place";
    return;
  }
  trails.follow(image, time, now(), previous(), seen);
  const bool is_new_place = recovery.insists() || recovery.query().is_not_known(trails.begun_at(), time);
  if (options.make_maps && !trails.awaited() && is_new_place)
    result.seed = trails.propose(image, time, now());
  if (result.seed) result.seed->second_up = gyro.up();
  trails.lines(&result.trails);
  result.note = trails.note();
}

/// Nothing is known yet of where the camera is in it.
void Tracker::State::enter_map(const MapSnapshotPtr& snapshot, Timestamp time) {
  adopt_revision(snapshot, time);
  trails.restart();
  result.trails.clear();
  result.note.clear();
}

/// The map of our own seed: where the camera is, the trails tell.
void Tracker::State::begin_map(const MapSnapshotPtr& snapshot, Timestamp time) {
  const SeedAnswer seed = *trails.awaited();
  const auto pose =
      pose_from_trails(*camera, *snapshot, seed, trails.live(), options.seed, options.trail_pose);
  enter_map(snapshot, time);
  if (const KeyframePose* second = map->find(seed.second_keyframe)) {
    const SE3 camera_from_map = pose.value_or(second->camera_from_map);
    latest = {map->map, second->id, camera_from_map * second->camera_from_map.inverse()};
    recovery.begin_map(latest, pose.has_value(), time);
    if (second->mean_depth > 0) mean_depth = near_depth = second->mean_depth;
    model.reset(camera_from_map, time);
  }
  seen = TinyMotion{};  // the trails' pose is of this frame already
  gyro.counted();
}

void Tracker::State::adopt_revision(const MapSnapshotPtr& server_map, Timestamp time) {
  counted.clear();
  local.advance(time, &counted);
  provisional.forget(counted);
  const MapSnapshotPtr snapshot = local.extend(server_map);
  if (map == snapshot) return;
  const bool same = map && map->map == snapshot->map;  // keyframes keep their ids when a server comes back
  if (!same) {                                         // ids of points and keyframes mean others in it
    recovery.enter_map();
    keyframes.enter_map();
    flow.missed();
    reckoning.seen();
    latest = {};
  }
  map = snapshot;
  finder.use_map(map);
  if (!same) return;
  if (const KeyframePose* moved = map->find(latest.reference))
    model.rebase(latest.camera_from_reference * moved->camera_from_map);
}

void Tracker::State::locate(Timestamp time, const MapSnapshotPtr& snapshot) {
  adopt_revision(snapshot, time);
  recovery.begin_frame(*map, near_depth, time);
  if (recovery.is_lost()) {
    const ScopedStage stage(probe, Stage::kRecover);
    miss(time, recovery.query().nobody_answers()
                   ? "looking from where it was before; nobody answers, more cannot be done"
                   : "asking where this is");
    look_for_camera(time);
  } else {
    track(time);
  }
  report_search();
}

/// From where the motion expects the camera; where it is not found, by what else tells where it is, in order
/// of cost.
void Tracker::State::track(Timestamp time) {
  Attempt found = search_by_motion(time);
  const bool is_verified = recovery.as<Verifying>() != nullptr;
  if (found.verdict == PoseVerdict::kBad && !is_verified) found = search_otherwise();
  if (found.verdict != PoseVerdict::kBad) {
    accept(found, time);
    return;
  }
  if (!is_verified && hold(time)) {
    if (!result.pose_measured) look_for_camera(time);
    return;
  }
  miss(time, fmt::format("{} of {} points found", finder.found(), finder.attempted()));
  if (!is_verified) look_for_camera(time);
}

Tracker::State::Attempt Tracker::State::attempt(const SE3& from, const SearchEffort& effort) {
  Attempt found;
  found.pose = finder.locate(now(), from, effort, probe);
  if (!found.pose) return found;
  found.evidence = {true, finder.judge(), finder.found(), finder.quality(), false, is_cut};
  return found;
}

Tracker::State::Attempt Tracker::State::judged(Attempt found, PoseOrigin origin) const {
  found.verdict = judge_frame(found.evidence, origin, recovery.state(), options);
  return found;
}

SearchEffort Tracker::State::expected_effort() const {
  SearchEffort effort = normal_effort(options);
  if (const auto* tracking = recovery.as<Tracking>()) {
    if (tracking->failed_frames == 0) effort.expected_quality = tracking->quality;
  } else if (const auto* verifying = recovery.as<Verifying>()) {
    effort.expected_quality = verifying->quality;
    effort.enough_aligned = 1;  // everything that speaks for it or against it
  }
  return effort;
}

/// From where the velocity and the small image expect the camera; where it is not found, twice as far about
/// where the small image alone does; then turned as the gyro says, and moved where that leaves it to be.
Tracker::State::Attempt Tracker::State::search_by_motion(Timestamp time) {
  const SE3 by_images =
      correct_step(model.predicted_step(time), seen, *camera, mean_depth, options.step_correction);
  const SE3 by_gyro = gyro.turn() ? model.predicted_step(time, *gyro.turn()) : by_images;
  const SE3 expected = (is_cut ? by_gyro : by_images) * model.last();
  Attempt found = attempt(expected, expected_effort());
  in_sight = finder.attempted();
  if (found.evidence.share == PoseVerdict::kBad)
    found = attempt(turned() * model.last(), wide_effort(options));
  if (found.evidence.share == PoseVerdict::kBad && gyro.turn() && !is_cut)
    found =
        attempt(correct_translation(by_gyro, seen, *camera, mean_depth) * model.last(), wide_effort(options));
  // Who comes back expects the camera degrees away from where it is: what is in sight, and how it looks, is
  // judged anew from the pose found.
  if (found.pose && recovery.as<Turned>() != nullptr) found = attempt(*found.pose, normal_effort(options));
  if (found.pose) found.evidence.is_leap = model.is_leap(*found.pose, expected, time, near_depth);
  found = judged(found, PoseOrigin::kMotion);
  const bool is_doubted =
      found.verdict != PoseVerdict::kBad && found.pose && !recovery.is_reachable(*found.pose);
  return is_doubted ? compared_within_reach(found) : found;
}

/// What repeats draws a search to another of its periods: the pose that shows where the camera can be is
/// preferred.
Tracker::State::Attempt Tracker::State::compared_within_reach(Attempt found) {
  const SE3 there = *found.pose;
  const Attempt near =
      judged(attempt(recovery.within_reach(there), normal_effort(options)), PoseOrigin::kMotion);
  if (near.verdict != PoseVerdict::kBad && near.pose && recovery.is_reachable(*near.pose)) return near;
  const bool is_leap = found.evidence.is_leap;
  found = attempt(there, normal_effort(options));
  found.evidence.is_leap = is_leap;
  return judged(found, PoseOrigin::kMotion);
}

Tracker::State::Attempt Tracker::State::search_otherwise() {
  if (const auto from = flow.pose(previous(), now(), seen, *map)) {
    const Attempt found = judged(attempt(*from, normal_effort(options)), PoseOrigin::kFlow);
    if (found.verdict != PoseVerdict::kBad) return found;
  }
  if (const auto from = recovery.by_corners(now(), *map, model.last(), mean_depth)) {
    const Attempt found = attempt(*from, normal_effort(options));
    if (found.pose && recovery.is_reachable(*found.pose)) return judged(found, PoseOrigin::kCorners);
  }
  return {};
}

SearchEffort Tracker::State::effort_of(PoseStart::Reach reach) const {
  if (reach == PoseStart::Reach::kNear) return normal_effort(options);
  SearchEffort effort = wide_effort(options);
  effort.needs_coarse = reach == PoseStart::Reach::kQuick;
  return effort;
}

/// From where it may be, one place after another: where it is found it is followed, and published once it has
/// held.
void Tracker::State::look_for_camera(Timestamp time) {
  while (const auto start = recovery.next_start(now(), *map, model.last(), mean_depth, time)) {
    Attempt found = attempt(start->camera_from_map, effort_of(start->reach));
    if (!found.pose) continue;
    const auto believed =
        recovery.believe(*start, {*found.pose, found.evidence.found, found.evidence.quality}, time);
    if (!believed) continue;
    found.verdict = PoseVerdict::kGood;
    recovery.begin_verifying(*believed, time);
    model.reset(*found.pose, time);
    accept(found, time);
    return;
  }
}

/// The camera was not found; it is expected where it has turned to.
void Tracker::State::miss(Timestamp time, std::string why) {
  model.missed(recovery.is_lost() && gyro.is_by_gyro() ? *gyro.turn() : turned());
  flow.missed();
  recovery.lose_sight(previous());
  recovery.fail(is_cut, time);
  result.state = TrackingState::kLost;
  result.note = std::move(why);
}

/// The camera has turned away from what the map shows: what it followed until then says where to. That is no
/// measurement by the map, and who is held is not lost.
bool Tracker::State::hold(Timestamp time) {
  const bool was_tracked = recovery.as<Tracking>() != nullptr || recovery.as<Turned>() != nullptr;
  if (!was_tracked || reckoning.is_over()) return false;
  const SE3 expected = turned() * model.last();
  // What a search found somewhere else does not show where the camera is.
  const bool is_here = finder.located() && !model.is_leap(*finder.located(), expected, time, near_depth);
  const auto reckoned = reckoning.by_corners(
      now(), expected, is_here ? std::span(finder.points()) : std::span<const VisiblePoint>{},
      {mean_depth, near_depth}, *map);
  if (!reckoned) return hold_blindly();
  if (!is_here) finder.clear();
  gyro.seen();
  measured(reckoned->camera_from_map, time);
  claim_held(reckoned->is_position_known);
  if (result.pose_measured && local.is_overdue()) propose_keyframe(time);
  return true;
}

/// Smeared by a quick turn, or blank, the frame shows nothing that could be followed; how far it turned, the
/// gyro says, or else the small images.
bool Tracker::State::hold_blindly() {
  const bool is_carried = in_sight < options.keyframes.scarce_points &&
                          gyro.carries(options.finder.coarse_radius / camera->focal_length());
  const SE3 expected = (is_carried ? *gyro.turn() : turned()) * model.last();
  if (is_carried) {
    reckoning.follow_turn(now(), expected, gyro.blind_sigma(), mean_depth, *map);
  } else if (!reckoning.follow_small_images(now(), expected, likeness, mean_depth, *map)) {
    return false;
  }
  finder.clear();  // what it found last is no part of this pose
  model.missed(is_carried ? *gyro.turn() : turned());
  claim_held(false);
  return true;
}

void Tracker::State::claim_held(bool is_position_known) {
  flow.missed();
  if (!is_position_known) recovery.turn_away();
  result.state = is_position_known ? TrackingState::kPoor : TrackingState::kRotation;
  result.pose_measured = is_position_known;
  result.mean_depth = mean_depth;
  result.note = is_position_known ? "" : "turned away from what the map shows";
}

void Tracker::State::measured(const SE3& camera_from_map, Timestamp time) {
  model.measured(camera_from_map, time);
  if (const KeyframePose* nearest = map->nearest_keyframe(camera_from_map.center())) {
    latest = {map->map, nearest->id, camera_from_map * nearest->camera_from_map.inverse()};
  }
}

void Tracker::State::accept(const Attempt& found, Timestamp time) {
  if (found.verdict == PoseVerdict::kGood && recovery.as<Tracking>() != nullptr)
    gyro.tracked(*found.pose * model.last().inverse());
  gyro.seen();
  measured(*found.pose, time);
  reckoning.seen();
  flow.tracked(finder.points());
  mean_depth = finder.mean_depth().value_or(mean_depth);
  near_depth = finder.near_depth().value_or(near_depth);
  if (recovery.confirm(found.evidence.quality, latest, time, found.evidence.is_leap)) {
    publish(found, time);
    return;
  }
  result.state = TrackingState::kLost;
  result.verifying = true;
  result.note = "proving a pose that was found";
}

void Tracker::State::publish(const Attempt& found, Timestamp time) {
  result.state = found.verdict == PoseVerdict::kGood ? TrackingState::kTracking : TrackingState::kPoor;
  result.note.clear();
  result.pose_measured = true;
  result.mean_depth = mean_depth;
  local.settle_in(map->map);
  exposure.learn(now(), finder.points(), *map);
  provisional.follow(now(), *found.pose, *map);
  provisional.update(now(), {*found.pose, finder.covariance(), PoseSupport::kPosition, mean_depth}, *map,
                     finder.points());
  if (!is_sound(found.evidence, found.verdict, options)) return;
  recovery.remember(now(), *map, {latest.reference, latest.camera_from_reference, mean_depth}, flow.seen());
  propose_keyframe(time);
}

void Tracker::State::propose_keyframe(Timestamp time) {
  if (!options.make_keyframes || map->find(latest.reference) == nullptr || !local.has_room(time)) return;
  const double distance = latest.camera_from_reference.center().norm() / mean_depth;
  const auto is_new = [this] { return shows_new_area(now(), finder.points(), options.keyframes, probe); };
  const bool widens = widens_map(*map, model.last().center(), mean_depth);
  if (!keyframes.wants(finder.found(), distance, widens, is_new)) return;
  KeyframeProposal proposal{map->map,
                            map->epoch,
                            map->revision,
                            latest.reference,
                            latest.camera_from_reference,
                            {},
                            provisional.candidates(model.last())};
  proposal.number = ++proposals;
  proposal.still = now().still();
  proposal.up = gyro.up();
  for (const VisiblePoint& p : finder.points()) {
    if (p.found && !is_local(p.id)) proposal.measurements.push_back({p.id, p.level, p.pixel});
  }
  map_locally(time, &proposal);
  if (is_local(latest.reference)) {
    proposal.reference = {};
    proposal.reference_number = LocalMap::number_of(latest.reference);
  }
  result.keyframe = std::move(proposal);
}

/// Until the server answers, it is a keyframe of the tracker's own, and nobody else adjusts it.
void Tracker::State::map_locally(Timestamp time, KeyframeProposal* proposal) {
  known.clear();
  provisional.known(&known);
  measurements.clear();
  provisional.measurements(finder.points(), &measurements);
  local.propose(*proposal, model.last(), static_cast<float>(mean_depth), time, known, measurements);
  if (!local.is_overdue()) return;
  if (const auto adjusted = local.adjust(camera)) proposal->camera_from_reference = *adjusted;
}

void Tracker::State::report_search() {
  result.map = map->map;
  result.epoch = map->epoch;
  result.revision = map->revision;
  result.attempted = finder.attempted();
  result.found = finder.found();
  result.quality = finder.quality();
  result.reprojection_rms = finder.rms();
  for (const VisiblePoint& p : finder.points())
    result.points.push_back({p.id, p.level, p.found, p.found ? p.pixel : p.expected});
}

void Tracker::State::end_frame(Timestamp time) {
  {
    const ScopedStage stage(probe, Stage::kDescribe);
    result.reloc_query = recovery.ask(now(), time, may_enter(), gyro.up());
  }
  learn_still();
  result.camera_from_map = model.last();
  result.imu = gyro.use();
  has_previous = true;
}

void Tracker::State::learn_still() {
  const ScopedStage stage(probe, Stage::kCorners);
  const bool has_time = recovery.is_starting() || recovery.is_lost();
  if (still.look(now().pyramid, has_time))
    now().use_mask(still.mask());  // the next frame is compared with this one
}

Tracker::Tracker(const CameraPtr& camera, const TrackerOptions& options)
    : state_(std::make_unique<State>(camera, options)) {}
Tracker::~Tracker() = default;

const FrameResult& Tracker::track(const GrayImagePtr& image, Timestamp time, const MapSnapshotPtr& map,
                                  StageProbe* probe) {
  State& s = *state_;
  s.begin_frame(image, time, probe);
  if (s.recovery.is_starting()) s.start(image, time, map);
  if (!s.recovery.is_starting() && map) s.locate(time, map);
  s.end_frame(time);
  return s.result;
}

void Tracker::use_imu(const std::optional<ImuMount>& mount) {
  state_->gyro.use(mount);
}

void Tracker::add_samples(std::span<const ImuSample> samples) {
  state_->gyro.add(samples);
}

void Tracker::add_encoders(std::span<const EncoderSample> samples) {
  state_->gyro.add(samples);
}

void Tracker::use_camera(const CameraPtr& camera) {
  State& s = *state_;
  s.camera = camera;
  s.recovery.use_camera(camera);
  s.trails.use_camera(camera);
  s.finder.use_camera(camera);
  s.flow.use_camera(camera);
  s.provisional.use_camera(camera);
}

void Tracker::seed_accepted(const SeedAnswer& answer) {
  state_->trails.accepted(answer);
}

void Tracker::seed_refused(const std::string& reason) {
  state_->trails.refused(reason);
}

void Tracker::make_keyframes(bool wanted) {
  state_->options.make_keyframes = wanted;
}

void Tracker::keyframe_answered(uint64_t number, std::optional<KeyframeId> keyframe) {
  state_->local.answered(number, keyframe);
}

PlaceUse Tracker::relocalization_answered(const std::optional<PoseHypothesis>& hypothesis) {
  const State& s = *state_;
  const auto in_use = s.map ? std::optional(s.map->map) : std::nullopt;
  return state_->recovery.answered(hypothesis, in_use, s.may_enter());
}

void Tracker::place_left_open() {
  state_->recovery.left_open();
}

void Tracker::start_over(NewMap wish) {
  State& s = *state_;
  s.recovery.start_over(wish == NewMap::kInAnyCase && s.options.make_maps);
  s.trails.restart();
  s.local.clear();
  s.map.reset();
  s.latest = {};
}

}  // namespace cairn
