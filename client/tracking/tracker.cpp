// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/tracker.h"

#include <fmt/format.h>
#include <array>
#include <utility>

#include "client/relocalization/keyframe_rounds.h"
#include "client/relocalization/place_memory.h"
#include "client/relocalization/place_question.h"
#include "client/tracking/keyframe_policy.h"
#include "client/tracking/motion.h"
#include "client/tracking/pose_finder.h"
#include "client/tracking/pose_priors.h"
#include "client/tracking/still_regions.h"
#include "client/tracking/trail_pose.h"
#include "client/tracking/trails.h"
#include "common/image/frame_images.h"

namespace cairn {
namespace {

constexpr int kEnoughPoints = 50;     // found: the pose is sound although most of the map is out of sight
constexpr int kProofFrames = 3;       // in a row, for a pose that was found by looking for it
constexpr int kFewestRecovered = 25;  // points found in each of them,
constexpr float kRecoveredQuality = 0.4F;  // and their share;
// A place where the camera can have got to since it was tracked needs less: this share of the quality it had.
constexpr float kQualityKept = 0.7F;
// Points followed from the frame before know no look-alikes: so many may agree of a map that has most
// elsewhere.
constexpr float kFlowQuality = 0.1F;
constexpr float kSuggestedQuality =
    0.25F;                            // less for a place that geometry speaks for: it may be poorly mapped
constexpr size_t kMemoriesTried = 3;  // candidates of the memory, by successive frames
// A camera that has been lost for longer, or has since seen what no map is known of, may have been carried
// elsewhere, to a place that looks the same from where it was [s].
constexpr double kStillHere = 1.0;
// Correlation of the tiny images of two frames, the motion between them undone: below, they show different
// things, most likely; strangers are above now and then, and cost two frames more.
constexpr float kSameView = 0.5F;
// While it tracks: what stands still is learnt from every so many frames, since their corners cost a
// millisecond.
constexpr int kLearnEvery = 8;
constexpr double kWitnessPatience = 0.2;  // [s] an answer takes a frame or two

/// Who says where the camera may be.
enum class Guess : uint8_t { kSuggested, kOwn };

/// In order of how far a pose is to be believed.
constexpr bool is_worse(PoseVerdict a, PoseVerdict b) {
  return a > b;
}

float proof_of(Guess whose) {
  return whose == Guess::kSuggested ? kSuggestedQuality : kRecoveredQuality;
}

}  // namespace

const char* to_string(Stage stage) {
  constexpr std::array<const char*, static_cast<size_t>(Stage::kCount)> kNames = {
      "pyramid", "corners", "prior", "project", "coarse", "fine", "pose", "trails", "recover", "describe"};
  return kNames[static_cast<size_t>(stage)];
}

struct Tracker::State {
  State(const CameraPtr& camera_in, const TrackerOptions& options_in)
      : camera(camera_in),
        options(options_in),
        trails(camera_in, options_in),
        finder(camera_in, options_in),
        priors(camera_in, options_in.seed),
        keyframes(options_in) {}

  CameraPtr camera;
  TrackerOptions options;
  TrailFollower trails;
  PoseFinder finder;
  PosePriors priors;
  KeyframePolicy keyframes;
  PlaceMemory places;
  PlaceQuestion question;
  KeyframeRounds rounds;
  MotionModel model;

  StillRegions still;
  int frames_unlearnt = 0;  ///< since it learnt last
  std::array<FrameImages, 2> frames;
  size_t current = 0;
  bool has_previous = false;
  TinyMotion seen;             ///< how the tiny image moved since the previous frame
  bool is_cut = false;         ///< it has nothing in common with it
  bool failed_at_cut = false;  ///< the first of the bad frames had not

  bool starting = true;
  bool insists = false;  ///< a new map, whatever is known of the place
  std::optional<SeedAnswer> awaited;
  MapSnapshotPtr map;

  /// A pose relative to the keyframe nearest to it, so that it survives adjustments.
  struct Anchor {
    MapId map;
    KeyframeId reference;
    SE3 camera_from_reference;
  };
  Anchor latest;          ///< of the last pose measured
  Anchor proven;          ///< of the last one published,
  Timestamp proven_time;  ///< and when
  double mean_depth = 1;
  float last_quality = 0;  ///< of the last frame that was tracked in this map; 0: none was
  int bad_frames = 0;
  size_t lost_frames = 0;
  /// A pose that was found by looking for it, to be proven before it is published.
  struct Trial {
    int frames_left = 0;  ///< that must still confirm it
    float quality = 0;    ///< in each of them
    /// When it began, if the place is the tracker's own guess: that knows one map only, and the server, which
    /// compares with all, is to be heard about a frame from then on.
    std::optional<Timestamp> witness_from;
  };
  std::optional<Trial> trial;

  FrameResult result;
  StageProbe* probe = nullptr;

  FrameImages& now() { return frames[current]; }
  FrameImages& previous() { return frames[1 - current]; }
  [[nodiscard]] bool is_lost() const { return bad_frames >= options.lost_after_bad_frames; }
  /// Whether a place suggested would be tried.
  [[nodiscard]] bool is_looking() const {
    return starting ? !trails.is_undecided() && !awaited && !insists : is_lost();
  }
  /// Whether it is worth asking where this is: the answer takes its time, and one frame that fails may be the
  /// first of many.
  [[nodiscard]] bool is_asking() const { return starting ? is_looking() : bad_frames > 0 || lacks_witness(); }
  [[nodiscard]] bool lacks_witness() const {
    return trial && trial->witness_from && !question.is_answered_since(*trial->witness_from);
  }
  /// The map in use is left for another only when lost, or when the picture changed as no hand can move.
  [[nodiscard]] bool wants(const PoseSuggestion& place) const {
    return is_looking() || (is_asking() && (failed_at_cut || place.map == map->map));
  }

  void clear_result();
  void prepare(const GrayImagePtr& image);
  void ask_place(Timestamp time);
  void learn_still();

  void follow_trails(const GrayImagePtr& image, Timestamp time);
  void enter_map(const MapSnapshotPtr& snapshot);
  void begin_map(const MapSnapshotPtr& snapshot, Timestamp time);
  void adopt_revision(const MapSnapshotPtr& snapshot);

  void track_map(Timestamp time);
  /// What a search of the frame found, and how far it is to be believed.
  struct Attempt {
    std::optional<SE3> pose;
    PoseVerdict verdict = PoseVerdict::kBad;
  };
  [[nodiscard]] Attempt attempt(const SE3& start, const SearchEffort& effort);
  [[nodiscard]] Attempt attempt_as_expected(Timestamp time);
  [[nodiscard]] Attempt attempt_otherwise();
  /// How the camera turned since the frame before, by the small images.
  [[nodiscard]] SE3 turned() const { return correct_step(SE3(), seen, *camera, mean_depth); }
  /// Of those in sight, for a place where the camera can have got to.
  [[nodiscard]] float needed_quality() const {
    return std::clamp(kQualityKept * last_quality, options.lost_quality, kRecoveredQuality);
  }
  void miss();
  [[nodiscard]] bool found_as_suggested(Timestamp time);
  void recover(Timestamp time);
  [[nodiscard]] bool found_from(const SE3& start, const SearchEffort& effort, Guess whose, Timestamp time);
  [[nodiscard]] bool holds_proof(float quality) const {
    return finder.found() >= kFewestRecovered && finder.quality() >= quality;
  }
  [[nodiscard]] bool stays_on_trial(Timestamp time);
  [[nodiscard]] bool is_contradicted_by(const PoseSuggestion& place) const;
  void contradict();
  void accept(const SE3& camera_from_map, Timestamp time, PoseVerdict verdict);
  void publish(Timestamp time, PoseVerdict verdict);
  [[nodiscard]] bool is_sound(PoseVerdict verdict) const;
  [[nodiscard]] bool may_be_elsewhere(Timestamp time) const;
  void propose_keyframe();
  void report_search();
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
    now().build_pyramid(image->view(), still.mask());
  }
  const ScopedStage stage(probe, Stage::kPrior);
  now().build_tiny();
  seen = has_previous ? align_tiny(previous().tiny, now().tiny) : TinyMotion{};
  is_cut = has_previous && !(tiny_correlation(previous().tiny, now().tiny, seen) >= kSameView);
}

void Tracker::State::ask_place(Timestamp time) {
  const ScopedStage stage(probe, Stage::kDescribe);
  result.place_question = question.ask(now(), time);
}

/// Until it is known what stands still, and again while there is nothing to track.
void Tracker::State::learn_still() {
  const ScopedStage stage(probe, Stage::kCorners);
  const bool is_turn = ++frames_unlearnt >= kLearnEvery && !still.has_judged();
  const bool learns = starting || is_lost() || is_turn;
  if (learns) frames_unlearnt = 0;
  const bool is_news =
      learns ? still.learn(now().pyramid) : still.watch(now().pyramid.level(kPyramidLevels - 1));
  if (is_news) now().use_mask(still.mask());  // the next frame is compared with this one
}

void Tracker::State::follow_trails(const GrayImagePtr& image, Timestamp time) {
  const ScopedStage stage(probe, Stage::kTrails);
  if (!options.make_maps && !awaited) {
    result.note = "looking for a map of this place";
    return;
  }
  trails.follow(image, time, now(), previous(), seen);
  const bool is_new_place = insists || question.is_not_known(trails.begun_at(), time);
  if (options.make_maps && !awaited && is_new_place) result.seed = trails.propose(image, time, now());
  trails.lines(&result.trails);
  result.note = trails.note();
}

/// Nothing is known yet of where the camera is in it.
void Tracker::State::enter_map(const MapSnapshotPtr& snapshot) {
  adopt_revision(snapshot);
  bad_frames = options.lost_after_bad_frames;
  last_quality = 0;
  starting = false;
  insists = false;
  keyframes.enter_map();
  awaited.reset();
  trails.restart();
  result.trails.clear();
  result.note.clear();
}

/// The map of our own seed: where the camera is, the trails tell.
void Tracker::State::begin_map(const MapSnapshotPtr& snapshot, Timestamp time) {
  const SeedAnswer seed = *awaited;
  const auto pose = pose_from_trails(*camera, *snapshot, seed, trails.live(), options.seed);
  enter_map(snapshot);
  if (const KeyframePose* second = map->find(seed.second_keyframe)) {
    const SE3 camera_from_map = pose.value_or(second->camera_from_map);
    latest = proven = {map->map, second->id, camera_from_map * second->camera_from_map.inverse()};
    if (second->mean_depth > 0) mean_depth = second->mean_depth;
    model.reset(camera_from_map, time);
  }
  seen = TinyMotion{};  // the trails' pose is of this frame already
  if (pose) bad_frames = 0;
}

void Tracker::State::adopt_revision(const MapSnapshotPtr& snapshot) {
  if (map == snapshot) return;
  const bool is_other_map = map && map->map != snapshot->map;
  const bool same = map && !is_other_map;  // keyframes keep their ids when a server comes back with the map
  if (is_other_map) {
    bad_frames = options.lost_after_bad_frames;
    trial.reset();
    latest = {};
    last_quality = 0;
    keyframes.enter_map();
  }
  map = snapshot;
  finder.use_map(map);
  if (!same) return;
  if (const KeyframePose* moved = map->find(latest.reference)) {
    model.rebase(latest.camera_from_reference * moved->camera_from_map);
  }
}

void Tracker::State::accept(const SE3& camera_from_map, Timestamp time, PoseVerdict verdict) {
  model.measured(camera_from_map, time);
  bad_frames = 0;
  last_quality = finder.quality();
  priors.tracked(finder.points());
  mean_depth = finder.mean_depth().value_or(mean_depth);
  if (const KeyframePose* nearest = map->nearest_keyframe(camera_from_map.center())) {
    latest = {map->map, nearest->id, camera_from_map * nearest->camera_from_map.inverse()};
  }
  if (trial && stays_on_trial(time)) {
    result.state = TrackingState::kLost;
    result.on_trial = true;
    result.note = "proving a pose that was found";
    return;
  }
  trial.reset();
  publish(time, verdict);
}

/// One frame more has confirmed it.
bool Tracker::State::stays_on_trial(Timestamp time) {
  if (--trial->frames_left > 0) return true;
  return lacks_witness() && !question.nobody_answers() &&
         std::abs(seconds_between(time, *trial->witness_from)) < kWitnessPatience;
}

/// Whether the server knows the camera in another map than the one in which it is on trial by its own guess.
bool Tracker::State::is_contradicted_by(const PoseSuggestion& place) const {
  return trial && trial->witness_from && question.is_answered_since(*trial->witness_from) &&
         place.confirmed && place.map != map->map;
}

void Tracker::State::contradict() {
  trial.reset();
  bad_frames = options.lost_after_bad_frames;
  question.contradict();
}

void Tracker::State::publish(Timestamp time, PoseVerdict verdict) {
  lost_frames = 0;
  question.prove();
  proven = latest;
  proven_time = time;
  result.state = verdict == PoseVerdict::kGood ? TrackingState::kTracking : TrackingState::kPoor;
  result.note.clear();
  result.pose_measured = true;
  result.mean_depth = mean_depth;
  if (is_sound(verdict)) {
    places.remember(now(), *map, latest.reference, latest.camera_from_reference, mean_depth);
    priors.remember(now(), *map, {latest.reference, latest.camera_from_reference, mean_depth});
  }
  if (options.make_keyframes && is_sound(verdict)) propose_keyframe();
}

/// Good enough to be built upon. Many points do where most of the map is out of sight; but of a place that
/// looks like this one some are found, too.
bool Tracker::State::is_sound(PoseVerdict verdict) const {
  return verdict == PoseVerdict::kGood ||
         (finder.found() >= kEnoughPoints && finder.quality() > options.lost_quality);
}

bool Tracker::State::may_be_elsewhere(Timestamp time) const {
  const double since = seconds_between(time, proven_time);
  return since < 0 || since > kStillHere || question.is_elsewhere();
}

void Tracker::State::propose_keyframe() {
  if (map->find(latest.reference) == nullptr) return;
  if (!keyframes.wants(finder.found(), latest.camera_from_reference.center().norm() / mean_depth)) return;
  KeyframeProposal proposal{
      map->map, map->epoch, map->revision, latest.reference, latest.camera_from_reference, {}};
  for (const VisiblePoint& p : finder.points()) {
    if (p.found) proposal.measurements.push_back({p.id, p.level, p.pixel});
  }
  result.keyframe = std::move(proposal);
}

Tracker::State::Attempt Tracker::State::attempt(const SE3& start, const SearchEffort& effort) {
  const auto pose = finder.locate(now(), start, effort, probe);
  return {pose, pose ? finder.judge() : PoseVerdict::kBad};
}

/// From where the velocity and the small image expect the camera; where it is not found, twice as far about
/// where the small image alone does.
Tracker::State::Attempt Tracker::State::attempt_as_expected(Timestamp time) {
  const SE3 expected = correct_step(model.predicted_step(time), seen, *camera, mean_depth) * model.last();
  SearchEffort effort = normal_effort(options);
  effort.expected_quality = bad_frames == 0 ? last_quality : 0;
  if (trial) effort.enough_aligned = 1;  // it is on trial: everything that speaks for it or against it
  Attempt found = attempt(expected, effort);
  if (found.verdict == PoseVerdict::kBad) found = attempt(turned() * model.last(), wide_effort(options));
  // What leaves the picture is tracked on its last points, all of them to one side, and with these the pose
  // runs away before it is lost.
  const bool runs_away = found.verdict == PoseVerdict::kPoor && finder.found() < kEnoughPoints &&
                         model.is_leap(*found.pose, expected, time, mean_depth);
  // After a frame that failed or that showed something else the start is a guess: what is found from there
  // must look right to be believed. What has left the picture is found again centimetres off, on its last
  // points.
  const bool is_guess =
      (found.verdict == PoseVerdict::kPoor && is_cut) || (bad_frames > 0 && !holds_proof(needed_quality()));
  if (runs_away || is_guess) found.verdict = PoseVerdict::kBad;
  return found;
}

/// From what else tells where the camera is, in order of cost.
Tracker::State::Attempt Tracker::State::attempt_otherwise() {
  const auto poor_at_least = [this](const std::optional<SE3>& pose) {
    return Attempt{pose, std::max(finder.judge(), PoseVerdict::kPoor, is_worse)};
  };
  if (const auto start = priors.by_flow(previous(), now(), seen, *map)) {
    const Attempt found = attempt(*start, normal_effort(options));
    if (found.pose && finder.found() >= kEnoughPoints && finder.quality() >= kFlowQuality)
      return poor_at_least(found.pose);
  }
  if (const auto start = priors.by_corners(now(), *map, model.last(), mean_depth)) {
    const Attempt found = attempt(*start, normal_effort(options));
    if (found.pose && holds_proof(needed_quality())) return poor_at_least(found.pose);
  }
  return {};
}

void Tracker::State::track_map(Timestamp time) {
  Attempt found = attempt_as_expected(time);
  if (found.verdict == PoseVerdict::kBad && !trial) found = attempt_otherwise();
  const bool is_refuted = trial && !(found.pose && holds_proof(trial->quality));
  if (found.verdict != PoseVerdict::kBad && !is_refuted) {
    accept(*found.pose, time, found.verdict);
    return;
  }
  miss();
  if (bad_frames++ == 0) failed_at_cut = is_cut;
  result.state = TrackingState::kLost;
  result.note = fmt::format("{} of {} points found", finder.found(), finder.attempted());
  if (trial) {
    trial.reset();
    bad_frames = options.lost_after_bad_frames;
    question.refute(time);
  } else {
    static_cast<void>(found_as_suggested(time));
  }
}

/// The camera was not found; it is expected where the small image says that it has turned to.
void Tracker::State::miss() {
  model.missed(turned());
  priors.missed();
}

/// Tries the place that others say, if they say one of this map.
bool Tracker::State::found_as_suggested(Timestamp time) {
  const auto place = question.take(now(), *camera, *map);
  if (!place) return false;
  // What geometry confirms is right to a few pixels: who looks no farther meets fewer look-alikes.
  if (question.took_confirmed() && found_from(*place, normal_effort(options), Guess::kSuggested, time))
    return true;
  if (found_from(*place, wide_effort(options), Guess::kSuggested, time)) return true;
  question.refute(time);
  return false;
}

/// Tries, in this order, what others say, what the tracker remembers while it cannot have gone far, and, if
/// there are no others, what the map offers. Desks look alike to who compares with one map only: after a
/// while it takes the word of the server, which compares with all, and asks for more likeness than points can
/// show.
void Tracker::State::recover(Timestamp time) {
  const ScopedStage stage(probe, Stage::kRecover);
  miss();
  result.state = TrackingState::kLost;
  result.note = question.nobody_answers()
                    ? "looking from where it was before; nobody answers, more cannot be done"
                    : "asking where this is";
  const SearchEffort wide = wide_effort(options);
  if (found_as_suggested(time)) return;
  if (may_be_elsewhere(time) && !question.nobody_answers()) return;
  if (const auto pose = priors.by_corners(now(), *map, model.last(), mean_depth)) {
    if (found_from(*pose, normal_effort(options), Guess::kOwn, time)) return;
  }
  if (const auto place = places.recall(now(), *camera, *map, lost_frames++ % kMemoriesTried)) {
    if (found_from(*place, wide, Guess::kOwn, time)) return;
  }
  if (const KeyframePose* keyframe = proven.map == map->map ? map->find(proven.reference) : nullptr) {
    const SE3 last = proven.camera_from_reference * keyframe->camera_from_map;
    if (found_from(last, wide, Guess::kOwn, time)) return;
  }
  if (!question.nobody_answers()) return;
  SearchEffort quick = wide;
  quick.needs_coarse = true;
  for (size_t i = 0; i < KeyframeRounds::kPerFrame; ++i) {
    const auto start = rounds.next(*map);
    if (start && found_from(*start, quick, Guess::kOwn, time)) return;
  }
}

/// Whether the camera is found near `start`: it is followed from there on, and published once it has held.
/// Whoever looks everywhere finds something somewhere.
bool Tracker::State::found_from(const SE3& start, const SearchEffort& effort, Guess whose, Timestamp time) {
  const auto pose = finder.locate(now(), start, effort, probe);
  if (!pose || !holds_proof(proof_of(whose))) return false;
  trial = {kProofFrames, proof_of(whose), whose == Guess::kOwn ? std::optional(time) : std::nullopt};
  model.reset(*pose, time);
  accept(*pose, time, PoseVerdict::kGood);
  return true;
}

void Tracker::State::report_search() {
  result.map = map->map;
  result.epoch = map->epoch;
  result.revision = map->revision;
  result.attempted = finder.attempted();
  result.found = finder.found();
  result.quality = finder.quality();
  result.reprojection_rms = finder.rms();
  for (const VisiblePoint& p : finder.points()) {
    result.points.push_back({p.id, p.level, p.found, p.found ? p.pixel : p.expected});
  }
}

Tracker::Tracker(const CameraPtr& camera, const TrackerOptions& options)
    : state_(std::make_unique<State>(camera, options)) {}
Tracker::~Tracker() = default;

const FrameResult& Tracker::track(const GrayImagePtr& image, Timestamp time, const MapSnapshotPtr& map,
                                  StageProbe* probe) {
  State& s = *state_;
  s.probe = probe;
  s.clear_result();
  s.priors.next_frame();
  s.finder.clear();
  s.keyframes.next_frame();
  s.prepare(image);

  if (s.starting) {
    s.follow_trails(image, time);
    if (map && s.awaited && map->map == s.awaited->map) {
      s.begin_map(map, time);
    } else if (map && s.is_looking()) {
      s.enter_map(map);
    }
  }
  if (!s.starting && map) {
    s.adopt_revision(map);
    if (s.is_lost()) {
      s.recover(time);
    } else {
      s.track_map(time);
    }
    s.report_search();
  }
  if (s.is_asking()) s.ask_place(time);
  s.learn_still();
  s.result.camera_from_map = s.model.last();
  s.has_previous = true;
  return s.result;
}

void Tracker::use_camera(const CameraPtr& camera) {
  State& s = *state_;
  s.camera = camera;
  s.trails.use_camera(camera);
  s.finder.use_camera(camera);
  s.priors.use_camera(camera);
}

void Tracker::seed_accepted(const SeedAnswer& answer) {
  state_->awaited = answer;
}

void Tracker::seed_refused(const std::string& reason) {
  state_->trails.refused(reason);
}

PlaceUse Tracker::place_answered(const std::optional<PoseSuggestion>& suggestion) {
  if (!state_->question.answered(suggestion)) return PlaceUse::kNotKnown;
  if (state_->is_contradicted_by(*suggestion)) state_->contradict();
  if (state_->wants(*suggestion)) return PlaceUse::kTried;
  state_->question.drop_suggestion();
  return PlaceUse::kNotNeeded;
}

void Tracker::place_left_open() {
  state_->question.left_open();
}

void Tracker::start_over(NewMap wish) {
  State& s = *state_;
  s.starting = true;
  s.insists = wish == NewMap::kInAnyCase && s.options.make_maps;
  s.awaited.reset();
  s.trails.restart();
  s.question.restart();
  s.map.reset();
  s.latest = s.proven = {};
  s.bad_frames = 0;
  s.lost_frames = 0;
  s.trial.reset();
}

}  // namespace cairn
