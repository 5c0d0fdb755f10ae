// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/map_maker.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <iterator>

#include "common/bundle/find_cameras.h"
#include "server/mapping/adjustment.h"
#include "server/mapping/candidate_points.h"
#include "server/mapping/integrate.h"
#include "server/mapping/map_record.h"
#include "server/mapping/new_points.h"
#include "server/mapping/refind.h"
#include "server/mapping/seed.h"
#include "server/mapping/snapshot_builder.h"
#include "server/mapping/upkeep.h"

namespace cairn {
namespace {

constexpr std::array<int, kPyramidLevels> kLevelOrder{3, 0, 1, 2};  // PTAM r114

/// Number of points that may be made at a level. The finest one has most candidates by far; it may not use up
/// what the levels after it need.
int level_budget(int level, int remaining) {
  return level == 0 ? remaining / 2 : remaining;
}

}  // namespace

struct MapMaker::State {
  MapMakerOptions options;
  KeyframeSpacing spacing;
  MapState map;
  bool plane_aligned = false;
  SnapshotBuilder builder;
  MapRecorder recorder = {};
  std::deque<PendingKeyframe> wanting_points = {};
  std::deque<PointId> wanting_observers = {};  ///< new points, to be found in old keyframes
  KeyframeId newest;                           ///< around which the local adjustment goes
  bool local_adjustment_due = false;
  bool upkeep_due = false;
  bool global_adjustment_due = false;

  /// Why there is no room for another keyframe; empty when there is.
  [[nodiscard]] std::string why_full() const;
  /// Whether step() has nothing to do.
  [[nodiscard]] bool is_idle() const;
  [[nodiscard]] WorkRecord work() const;
  void take_up(const WorkRecord& work);
  StepReport make_points(const std::function<bool()>& should_yield);
  KeyframeDecision integrate_with_prior(const KeyframeInput& input, const CameraPrior& prior,
                                        const DecodeImage& decode);
  /// Makes points of a frame's candidates. Returns how many.
  int take_candidates(KeyframeId keyframe, const KeyframeInput& input);
  StepReport adjust(const std::function<bool()>& should_yield);
  StepReport find_new_in_old(const std::function<bool()>& should_yield);
  StepReport tidy();
  /// Queues every live point to be searched again in all keyframes that do not show it yet.
  void search_everything();
};

std::string MapMaker::State::why_full() const {
  const auto say = [](const char* what, size_t made, size_t most) {
    return "map is full: " + std::to_string(made) + " of at most " + std::to_string(most) + " " + what +
           " have been made in it, removed ones included; go on in a new map beside it";
  };
  const size_t keyframes_to_come = wanting_points.size() + 1;
  const size_t points_to_come = keyframes_to_come * static_cast<size_t>(options.max_points_per_keyframe);
  if (map.points().size() + points_to_come > options.max_points)
    return say("points", map.points().size(), options.max_points);
  if (map.keyframes().size() >= kMaxKeyframes) return say("keyframes", map.keyframes().size(), kMaxKeyframes);
  return {};
}

bool MapMaker::State::is_idle() const {
  return wanting_points.empty() && wanting_observers.empty() && !local_adjustment_due && !upkeep_due;
}

StepReport MapMaker::State::make_points(const std::function<bool()>& should_yield) {
  StepReport report{.work = MapWork::kNewPoints};
  PendingKeyframe& pending = wanting_points.front();
  while (pending.next_level < kLevelOrder.size()) {
    const int level = kLevelOrder[pending.next_level];
    NewPointsLimits limits;
    limits.min_parallax = options.new_points.min_parallax;
    limits.max_points = level_budget(level, options.max_points_per_keyframe - pending.made);
    limits.first_candidate = pending.next_candidate;
    limits.extent = pending.extent;
    const NewPoints result =
        make_new_points(&map, pending.id, level, limits, options.new_points, should_yield);
    pending.made += static_cast<int>(result.made.size());
    wanting_observers.insert(wanting_observers.end(), result.made.begin(), result.made.end());
    report.changed |= !result.made.empty();
    if (!result.finished) {
      pending.next_candidate = result.next_candidate;
      report.finished = false;
      return report;
    }
    pending.next_candidate = 0;
    ++pending.next_level;
  }
  map.update_depths(pending.id);
  report.keyframe = pending.id;
  wanting_points.pop_front();
  return report;
}

StepReport MapMaker::State::adjust(const std::function<bool()>& should_yield) {
  StepReport report{.work = MapWork::kLocalAdjustment};
  bool stopped = false;
  const auto stop = [&] {
    stopped = stopped || should_yield();
    return stopped;
  };
  const BundleReport bundle = adjust_locally(&map, newest, options, stop);
  report.finished = !stopped;
  report.changed = bundle.usable;
  report.observations = bundle.observations;
  report.iterations = bundle.iterations;
  local_adjustment_due = stopped;
  return report;
}

StepReport MapMaker::State::find_new_in_old(const std::function<bool()>& should_yield) {
  StepReport report{.work = MapWork::kRefind};
  int tried = 0;
  while (!wanting_observers.empty()) {
    const PointId point = wanting_observers.front();
    wanting_observers.pop_front();
    for (size_t i = 0; i < map.keyframes().size(); ++i)
      report.changed |= refind(&map, KeyframeId{i + 1}, point, options.refind);
    tried += static_cast<int>(map.keyframes().size());
    if (tried < options.refind.per_poll) continue;
    tried = 0;
    if (!wanting_observers.empty() && should_yield()) {
      report.finished = false;
      return report;
    }
  }
  return report;
}

StepReport MapMaker::State::tidy() {
  StepReport report{.work = MapWork::kCull};
  upkeep_due = false;
  report.changed = cull_points(&map, options.upkeep) > 0;
  if (const auto redundant = find_redundant_keyframe(map, newest, options.upkeep)) {
    map.remove_keyframe(*redundant);
    report.changed = true;
  }
  return report;
}

void MapMaker::State::search_everything() {
  wanting_observers.assign(map.live_point_ids().begin(), map.live_point_ids().end());
  global_adjustment_due = true;
}

Result<std::pair<std::unique_ptr<MapMaker>, SeedResult>> MapMaker::start(const SeedInput& input,
                                                                         const MapMakerOptions& options) {
  auto seeded = seed_map(input, options);
  if (!seeded) return tl::unexpected(seeded.error());
  const KeyframeSpacing spacing =
      keyframe_spacing(options, seeded->map.keyframe(seeded->result.first_keyframe).mean_depth);
  auto state = std::make_unique<State>(
      State{.options = options,
            .spacing = spacing,
            .map = std::move(seeded->map),
            .plane_aligned = seeded->result.plane_aligned,
            .builder = SnapshotBuilder(input.map, input.map_name, input.epoch, options.publication),
            .newest = seeded->result.second_keyframe});
  return std::pair{std::unique_ptr<MapMaker>(new MapMaker(std::move(state))), std::move(seeded->result)};
}

Result<MapMaker::Restored> MapMaker::restore(const MapRecord& record, const MapIdentity& identity,
                                             const MapMakerOptions& options, RestoredImages images) {
  auto assembled = assemble_map(record, images);
  if (!assembled) return tl::unexpected(assembled.error());
  MapState& map = assembled->state;
  map.take_cameras_as_published(options.self_calibration);
  const FoundationRecord& foundation = *record.foundation;
  auto state = std::make_unique<State>(
      State{.options = options,
            .spacing = {foundation.min_distance_over_depth},
            .map = std::move(map),
            .plane_aligned = foundation.plane_aligned,
            .builder = SnapshotBuilder(identity.map, identity.name, identity.epoch, options.publication),
            .newest = KeyframeId{1}});
  if (record.work) state->take_up(*record.work);
  return Restored{std::unique_ptr<MapMaker>(new MapMaker(std::move(state))), std::move(assembled->repairs)};
}

MapMaker::MapMaker(std::unique_ptr<State> state) : state_(std::move(state)) {}
Status check_image_size(const GrayImage& image, const Camera& camera) {
  if (image.width() == camera.width() && image.height() == camera.height()) return {};
  return fail(ErrorCode::kDamaged, "the image is not of the camera's size");
}

MapMaker::~MapMaker() = default;

WorkRecord MapMaker::State::work() const {
  return {{wanting_points.begin(), wanting_points.end()},
          {wanting_observers.begin(), wanting_observers.end()},
          newest,
          local_adjustment_due,
          upkeep_due,
          global_adjustment_due};
}

void MapMaker::State::take_up(const WorkRecord& work) {
  for (const PendingKeyframe& p : work.wanting_points) {
    if (map.is_live(p.id)) wanting_points.push_back(p);
  }
  for (const PointId id : work.wanting_observers) {
    if (map.is_live(id)) wanting_observers.push_back(id);
  }
  if (map.is_live(work.newest)) newest = work.newest;
  local_adjustment_due = work.local_adjustment_due;
  upkeep_due = work.upkeep_due;
  global_adjustment_due = work.global_adjustment_due;
}

/// A keyframe of a camera that is calibrated: what the map knows of it counts more than what comes with it.
KeyframeDecision MapMaker::State::integrate_with_prior(const KeyframeInput& input, const CameraPrior& prior,
                                                       const DecodeImage& decode) {
  int camera = map.camera_index(prior);
  KeyframeInput known = input;
  if (camera >= 0) known.camera = map.cameras()[static_cast<size_t>(camera)].camera;
  KeyframeDecision decision = integrate_keyframe(&map, known, spacing, decode, options);
  if (decision.verdict != KeyframeVerdict::kAccepted) return decision;
  if (camera < 0) camera = map.add_camera(input.camera, prior);
  map.keyframe(decision.keyframe).estimated_camera = camera;
  return decision;
}

int MapMaker::State::take_candidates(KeyframeId keyframe, const KeyframeInput& input) {
  const std::vector<PointId> made =
      make_candidate_points(&map, keyframe, input.candidates, input.extent, options);
  if (made.empty()) return 0;
  wanting_observers.insert(wanting_observers.end(), made.begin(), made.end());
  map.update_depths(keyframe);
  return static_cast<int>(made.size());
}

KeyframeDecision MapMaker::add_keyframe(const KeyframeInput& input, const DecodeImage& decode) {
  State& s = *state_;
  if (std::string why = s.why_full(); !why.empty()) return {KeyframeVerdict::kFull, std::move(why), {}};
  KeyframeDecision decision = input.prior ? s.integrate_with_prior(input, *input.prior, decode)
                                          : integrate_keyframe(&s.map, input, s.spacing, decode, s.options);
  if (decision.verdict != KeyframeVerdict::kAccepted) return decision;
  s.newest = decision.keyframe;
  s.wanting_points.push_back(
      {decision.keyframe, 0, 0, s.take_candidates(decision.keyframe, input), input.extent});
  s.local_adjustment_due = true;
  s.upkeep_due = s.upkeep_due || !input.adds_only;
  s.global_adjustment_due = true;
  return decision;
}

bool MapMaker::has_work() const {
  return !state_->is_idle() || state_->global_adjustment_due;
}

StepReport MapMaker::step(const std::function<bool()>& should_yield) {
  State& s = *state_;
  if (!s.wanting_points.empty()) return s.make_points(should_yield);
  if (s.local_adjustment_due) return s.adjust(should_yield);
  if (!s.wanting_observers.empty()) return s.find_new_in_old(should_yield);
  if (s.upkeep_due) return s.tidy();
  return {};
}

bool MapMaker::wants_global_adjustment() const {
  return state_->is_idle() && state_->global_adjustment_due;
}

GlobalAdjustmentPtr MapMaker::prepare_global_adjustment() const {
  GlobalAdjustmentPtr copy(new GlobalAdjustment);
  copy->adjuster = state_->options.adjuster;
  copy->options = state_->options.adjustment;
  copy->problem = global_problem(state_->map, state_->options.self_calibration);
  copy->keyframes_at_cut = state_->map.keyframes().size();
  return copy;
}

StepReport MapMaker::adopt(const GlobalAdjustment& solved) {
  State& s = *state_;
  StepReport report{.work = MapWork::kGlobalAdjustment};
  report.observations = solved.report.observations;
  report.iterations = solved.report.iterations;
  report.changed = solved.report.usable;
  report.finished = solved.report.usable && solved.report.converged;
  if (solved.report.usable)
    write_back(solved.problem, solved.report.squared_cutoff, s.options.self_calibration, &s.map);
  // An unusable result would come out the same again: wait for the map to grow.
  const bool settled = report.finished || !solved.report.usable;
  if (settled && solved.keyframes_at_cut == s.map.keyframes().size()) s.global_adjustment_due = false;
  if (s.map.follow_cameras(s.options.self_calibration)) s.search_everything();
  return report;
}

MapSnapshotPtr MapMaker::snapshot() {
  state_->map.publish_cameras(state_->options);
  MapSnapshotPtr snapshot = state_->builder.build(state_->map);
  for (const auto& block : snapshot->point_blocks) state_->map.share_sources(block->patches);
  return snapshot;
}

std::vector<KeyframeView> MapMaker::keyframe_views() const {
  std::vector<KeyframeView> views;
  for (const MapKeyframe& k : state_->map.keyframes()) {
    if (!k.live) continue;
    KeyframeView& view = views.emplace_back();
    view.id = k.id;
    view.camera = k.camera;
    view.up = k.up;
    if (k.images) {
      view.pyramid = {k.images, &k.images->pyramid};
      view.corners = {k.images, &k.images->corners};
    }
    view.measurements.reserve(k.measurements.size());
    for (const Measurement& m : k.measurements) view.measurements.push_back({m.point, m.level, m.pixel});
  }
  return views;
}

void MapMaker::rename(const std::string& name) {
  state_->builder.rename(name);
}

MapRecord MapMaker::take_changes() {
  State& s = *state_;
  const FoundationRecord foundation{s.spacing.min_distance_over_depth, s.plane_aligned};
  return s.recorder.take(s.map, foundation, s.work());
}

void MapMaker::keep_everything_anew() {
  state_->recorder.reset();
}

void MapMaker::evict_images() {
  State& s = *state_;
  for (const MapKeyframe& k : s.map.keyframes()) {
    if (s.recorder.has_given_image(k.id)) s.map.keyframe(k.id).images = nullptr;
  }
}

bool MapMaker::lacks_any_images() const {
  const auto& keyframes = state_->map.keyframes();
  return std::any_of(keyframes.begin(), keyframes.end(), lacks_images);
}

std::vector<KeyframeId> MapMaker::lacking_images() const {
  std::vector<KeyframeId> lacking;
  for (const MapKeyframe& k : state_->map.keyframes()) {
    if (lacks_images(k)) lacking.push_back(k.id);
  }
  return lacking;
}

bool MapMaker::page_in_image(KeyframeId id, const GrayView& image) {
  MapKeyframe& k = state_->map.keyframe(id);
  if (image.width != k.camera->width() || image.height != k.camera->height()) return false;
  if (lacks_images(k)) k.images = prepare_images(image, k.still);
  return true;
}

MapStatistics MapMaker::statistics() const {
  const MapState& map = state_->map;
  MapStatistics stats;
  size_t& bytes_of_lacking = has_work() ? stats.bytes : stats.evicted_bytes;
  for (const MapKeyframe& k : map.keyframes()) {
    stats.keyframes += k.live ? 1 : 0;
    stats.measurements += k.measurements.size();
    stats.bytes +=
        sizeof(k) + k.measurements.capacity() * sizeof(Measurement) + k.given_up.capacity() * sizeof(PointId);
    if (k.images) stats.bytes += k.images->bytes();
    if (!lacks_images(k)) continue;
    ++stats.without_images;
    bytes_of_lacking += expected_image_bytes(*k.camera);
  }
  std::array<std::vector<float>, 3> coordinates;
  for (const MapPoint& p : map.points()) {
    stats.bytes += sizeof(p) + p.observers.capacity() * sizeof(KeyframeId);
    if (!p.live) continue;
    ++stats.points;
    for (int i = 0; i < 3; ++i)
      coordinates[static_cast<size_t>(i)].push_back(static_cast<float>(p.position[i]));
  }
  for (const MapCamera& c : map.cameras())
    stats.cameras.push_back(
        {c.version, c.published, c.published_sigma, c.published_frozen, c.published_unknown});
  const auto hundredth = static_cast<std::ptrdiff_t>(stats.points / 100);
  for (int i = 0; i < 3 && stats.points > 0; ++i) {
    std::vector<float>& c = coordinates[static_cast<size_t>(i)];
    const auto low = c.begin() + hundredth;
    const auto high = c.end() - 1 - hundredth;
    std::nth_element(c.begin(), low, c.end());
    stats.bounds_min[i] = *low;
    std::nth_element(low, high, c.end());
    stats.bounds_max[i] = *high;
  }
  return stats;
}

double MapMaker::reprojection_rms() const {
  const MapState& map = state_->map;
  double sum = 0;
  size_t measurements = 0;
  for (const MapKeyframe& k : map.keyframes()) {
    for (const Measurement& m : k.measurements) {
      const auto pixel = k.camera->project(k.camera_from_map * map.point(m.point).position);
      if (!pixel) continue;
      sum += (*pixel - m.pixel.cast<double>()).squaredNorm();
      ++measurements;
    }
  }
  return measurements > 0 ? std::sqrt(sum / static_cast<double>(measurements)) : 0;
}

void solve(GlobalAdjustment* problem, const std::function<bool()>& should_stop) {
  BundleProblem& bundle = problem->problem.bundle;
  const BundleOptions options = global_options(problem->options, should_stop);
  if (bundle.free_cameras.empty()) {
    problem->report = minimize(&bundle, options, problem->adjuster);
  } else {
    problem->report = find_cameras(&bundle, options);
  }
}

void GlobalAdjustmentDeleter::operator()(GlobalAdjustment* problem) const {
  std::default_delete<GlobalAdjustment>()(problem);
}

}  // namespace cairn
