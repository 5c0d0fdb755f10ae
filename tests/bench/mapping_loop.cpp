// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/mapping_loop.h"

#include <optional>
#include <utility>

#include "server/relocalization/relocalizer.h"
#include "tests/bench/timing.h"

namespace cairn {
namespace {

bool never() {
  return false;
}

}  // namespace

void finish_work(MapMaker* maker, bool local_only, MappingObserver* observer) {
  for (;;) {
    const double before = thread_cpu_ms();
    const StepReport report = maker->step(never);
    if (report.work != MapWork::kNone) {
      observer->on_work(report, thread_cpu_ms() - before);
      continue;
    }
    if (local_only || !maker->wants_global_adjustment()) return;
    const auto problem = maker->prepare_global_adjustment();
    solve(problem.get(), never);
    const StepReport adopted = maker->adopt(*problem);
    observer->on_work(adopted, thread_cpu_ms() - before);
  }
}

std::optional<PoseHypothesis> hypothesis_of(const RelocalizationAnswer& answer) {
  if (answer.verdict != RelocalizationVerdict::kConfirmed) return std::nullopt;
  const PlaceCandidate& best = answer.candidates.front();
  return PoseHypothesis{best.map, best.epoch, best.keyframe, best.camera_from_keyframe};
}

MappingLoop::MappingLoop(CameraPtr camera, const MappingOptions& options)
    : camera_(std::move(camera)),
      options_(options),
      observer_(options.observer != nullptr ? *options.observer : silent_) {
  TrackerOptions tracking;
  tracking.seed = options.seed;
  tracker_ = std::make_unique<Tracker>(camera_, tracking);
  if (options.imu != nullptr) tracker_->use_imu(options.imu->mount());
  maker_options_.seed = options.seed;
  maker_options_.adjuster = options.adjuster;
}

bool MappingLoop::is_cut(Timestamp time) const {
  const double second = seconds_between(time, *began_);
  return second >= options_.cut_from && second < options_.cut_to;
}

void MappingLoop::frame(const Frame& frame) {
  if (!began_) began_ = frame.time;
  if (!is_cut(frame.time)) {
    for (const auto& [proposal, from] : std::exchange(held_back_, {})) take_in(proposal, from);
  }
  if (options_.imu != nullptr) {
    samples_.clear();
    options_.imu->take(frame.time, &samples_);
    tracker_->add_samples(samples_);
  }
  const double before = thread_cpu_ms();
  const FrameResult& result = tracker_->track(frame.image, frame.time, snapshot_, options_.probe);
  observer_.on_frame(frame, result, thread_cpu_ms() - before);
  if (is_cut(frame.time)) {
    if (result.keyframe) held_back_.emplace_back(*result.keyframe, frame);
    return;
  }
  // Alone, a tracker is told no more than that there is no map yet.
  if (result.reloc_query && (options_.ask || !snapshot_)) answer(*result.reloc_query);
  if (result.seed) seed(*result.seed, frame);
  if (result.keyframe) take_in(*result.keyframe, frame);
}

MapRecord MappingLoop::record() {
  maker_->keep_everything_anew();
  return maker_->take_changes();
}

void MappingLoop::answer(const PlaceView& view) {
  const RelocalizationAnswer said = relocalize(index_, *camera_, view, RelocOptions());
  observer_.on_answer(said);
  static_cast<void>(tracker_->relocalization_answered(hypothesis_of(said)));
}

void MappingLoop::seed(const SeedProposal& proposal, const Frame& frame) {
  SeedInput input;
  input.map = options_.map;
  input.map_name = "map-1";
  input.epoch = Epoch{1};
  input.camera = camera_;
  input.prior = options_.prior;
  input.first_time = proposal.first_time;
  input.second_time = proposal.second_time;
  input.first_image = proposal.first_image;
  input.second_image = proposal.second_image;
  input.trails = proposal.trails;
  input.second_from_first = proposal.second_from_first;
  input.still = proposal.still;
  const double before = thread_cpu_ms();
  auto started = MapMaker::start(input, maker_options_);
  const double took = thread_cpu_ms() - before;
  if (!started) {
    observer_.on_seed(frame, proposal, tl::unexpected(started.error()), took);
    return tracker_->seed_refused(started.error().message);
  }
  maker_ = std::move(started->first);
  work();
  observer_.on_seed(frame, proposal, started->second, took);
  tracker_->seed_accepted({snapshot_->map, snapshot_->epoch, snapshot_->revision,
                           started->second.second_keyframe, started->second.points});
}

void MappingLoop::take_in(const KeyframeProposal& proposal, const Frame& frame) {
  KeyframeInput input{camera_,
                      frame.time,
                      frame.image,
                      proposal.reference,
                      proposal.camera_from_reference,
                      proposal.measurements,
                      proposal.candidates,
                      options_.prior};
  input.still = proposal.still;
  if (proposal.reference_number != 0) {
    const auto earlier = chain_.find(proposal.reference_number);
    if (earlier == chain_.end()) return tracker_->keyframe_answered(proposal.number, std::nullopt);
    input.reference = earlier->second.keyframe;
    input.camera_from_reference = input.camera_from_reference * earlier->second.camera_from_keyframe;
    input.is_chained = true;
  }
  const double before = thread_cpu_ms();
  const KeyframeDecision decision = maker_->add_keyframe(input);
  observer_.on_keyframe(frame, decision, thread_cpu_ms() - before);
  if (decision.verdict == KeyframeVerdict::kAccepted) {
    chain_[proposal.number] = {decision.keyframe, SE3()};
    work();
    tracker_->keyframe_answered(proposal.number, decision.keyframe);
  } else {  // as in server/service/map_runner, the next frame of the chain is judged by what it shows itself
    chain_[proposal.number] = {input.reference, input.camera_from_reference};
    tracker_->keyframe_answered(proposal.number, std::nullopt);
  }
}

void MappingLoop::work() {
  finish_work(maker_.get(), options_.local_only, &observer_);
  snapshot_ = maker_->snapshot();
  index_.put(index_map(index_.find(snapshot_->map), snapshot_, maker_->keyframe_views(), GravityOptions()));
  for (const CameraEstimate& estimate : maker_->statistics().cameras) use(estimate);
}

void MappingLoop::use(const CameraEstimate& estimate) {
  if (!options_.prior || estimate.version == options_.prior->version) return;
  camera_ = estimate.camera;
  options_.prior =
      estimate.frozen ? std::nullopt : std::optional(CameraPrior{estimate.version, estimate.sigma});
  tracker_->use_camera(camera_);
  observer_.on_camera(estimate);
}

}  // namespace cairn
