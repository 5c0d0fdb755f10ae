// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/tracker.h"

#include <fmt/format.h>

#include <span>
#include <utility>

#include "client/tracking/map_growth.h"
#include "client/tracking/tracker_state.h"
#include "client/tracking/trail_pose.h"

namespace cairn {
namespace {

RecoveryOptions recovery_options(const TrackerOptions& options) {
  RecoveryOptions recovery = options.recovery;
  recovery.seed = options.seed;
  recovery.least_quality = options.lost_quality;
  return recovery;
}

}  // namespace

Tracker::State::State(const CameraPtr& camera_in, const TrackerOptions& options_in)
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

/// Begins where there is no map yet: follows trails until they make one, or until a map of the place is
/// known.
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

/// Enters a map in which nothing is known yet of where the camera is.
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
  result.note = "verifying a pose that was found";
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

/// Takes a proposal into the tracker's own map. While answers are overdue it is adjusted there, for until the
/// server answers nobody else does that.
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
