// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_runner.h"

#include <cstring>
#include <exception>
#include <utility>

#include "common/base/cpu_time.h"
#include "common/io/image_file.h"
#include "server/service/resume.h"

namespace cairn {
namespace {

/// Rounds of "upkeep, then global adjustment" after which a lockstep job is answered even if the map maker
/// wants more: the same number on every run, so the answer is still reproducible.
constexpr int kMaxLockstepRounds = 8;
constexpr int kStepsOnly = kMaxLockstepRounds + 1;  // no global adjustment

constexpr const char* kInternalError = "internal error; the server's log says more";

wire::OfferDecision to_decision(KeyframeVerdict verdict) {
  switch (verdict) {
    case KeyframeVerdict::kAccepted:
      return wire::OfferDecision::kAccepted;
    case KeyframeVerdict::kTooClose:
      return wire::OfferDecision::kTooClose;
    case KeyframeVerdict::kTooFewPoints:
      return wire::OfferDecision::kTooFewPoints;
    case KeyframeVerdict::kStale:
      return wire::OfferDecision::kStale;
    case KeyframeVerdict::kOutside:
      return wire::OfferDecision::kNoRight;
    case KeyframeVerdict::kFull:
      return wire::OfferDecision::kFull;
    case KeyframeVerdict::kDamaged:
      break;
  }
  return wire::OfferDecision::kDamaged;
}

bool is_withdrawn(const std::shared_ptr<const PendingOffer>& pending) {
  return pending != nullptr && pending->is_withdrawn();
}

MapMeasures measures_of(const MapMaker& maker) {
  MapMeasures measures{maker.reprojection_rms(), {}};
  for (const KeyframeView& keyframe : maker.keyframe_views()) {
    const CameraParameters& camera = keyframe.camera->parameters();
    const auto known = std::find_if(measures.cameras.begin(), measures.cameras.end(),
                                    [&camera](const auto& c) { return c.first == camera; });
    if (known == measures.cameras.end()) {
      measures.cameras.emplace_back(camera, 1);
    } else {
      ++known->second;
    }
  }
  return measures;
}

}  // namespace

Result<GrayImagePtr> decode_image(const wire::ImageMessage& message) {
  const auto width = static_cast<int>(message.width);
  const auto height = static_cast<int>(message.height);
  if (message.encoding == wire::ImageEncoding::kRaw) {
    const size_t expected = static_cast<size_t>(message.width) * message.height;
    if (message.bytes.empty() || message.bytes.size() != expected) {
      return fail(ErrorCode::kDamaged, "raw image: size does not match its bytes");
    }
    return std::make_shared<const GrayImage>(GrayView{message.bytes.data(), width, height, width});
  }
  Result<GrayImage> decoded = decode_gray_image(message.bytes);
  if (!decoded) return tl::unexpected(decoded.error());
  if (decoded->width() != width || decoded->height() != height) {
    return fail(ErrorCode::kDamaged, "JPEG image: not of the stated size");
  }
  return std::make_shared<const GrayImage>(std::move(*decoded));
}

MapRunner::MapRunner(Executors executors, const MapMakerOptions& options, MapPersistence* store,
                     Listener listener, std::shared_ptr<const Clock> clock, Logger log, WorkTimes* times)
    : background_(executors.background),
      queue_(executors.urgent),
      options_(options),
      store_(store),
      clock_(std::move(clock)),
      listener_(std::move(listener)),
      log_(std::move(log)),
      times_(times),
      urgent_(executors.urgent) {}

void MapRunner::start(SeedJob job, SeedDone done) {
  auto make = [self = shared_from_this(), job = std::move(job), done = std::move(done)]() mutable {
    Result<SeedResult> result = fail(ErrorCode::kInternal, kInternalError);
    self->guarded([&] { result = self->make_map(&job); });
    if (!result) return done(std::move(result), nullptr);
    if (!job.lockstep) return self->answer_seed(job, std::move(result), done);
    self->finish_in_lockstep(
        [self, job = std::move(job), result, done] { self->answer_seed(job, result, done); });
  };
  queue_.post(std::move(make), Urgency::kUrgent);
}

void MapRunner::answer_seed(const SeedJob& job, Result<SeedResult> result, const SeedDone& done) {
  if (is_withdrawn(job.pending)) {
    stopping_ = true;
    return done(fail(ErrorCode::kRefused, kSeedWithdrawn), nullptr);
  }
  const bool published = !frozen_ && guarded([this] { publish(); });
  const bool handed_in = published && guarded([&] { keep_seed(job, *result, done); });
  if (!handed_in) return done(fail(ErrorCode::kInternal, kInternalError), nullptr);
  if (!job.lockstep) schedule_upkeep();
}

MapRevision MapRunner::resume(RestoredMap restored) {
  maker_ = std::move(restored.maker);
  epochs_ = std::move(restored.epochs);
  // A client that was cut off goes on with offers that hang on what was decided before the restart.
  for (const DecisionRecord& d : restored.decisions) {
    if (d.kind == CommandKind::kOffer && d.keyframe)
      chain_.put(d.client, d.session, d.seq, {d.keyframe, SE3()});
  }
  MapRevision first = {maker_->snapshot(), maker_->statistics(), maker_->keyframe_views(),
                       std::move(restored.indexed)};
  published_ = first.snapshot;
  return first;
}

void MapRunner::go_on() {
  queue_.post([self = shared_from_this()] {
    self->save_soon();
    self->schedule_upkeep();
  });
}

void MapRunner::retire() {
  deleted_ = true;
  stopping_ = true;
  queue_.post([self = shared_from_this()] {
    if (const auto waiting = self->awaiting_images_.lock()) self->end_reading(waiting);
  });
}

void MapRunner::measure(std::function<void(const MapMeasures&)> done) {
  queue_.post([self = shared_from_this(), done = std::move(done)] {
    MapMeasures measures;
    if (self->maker_ != nullptr) self->guarded([&] { measures = measures_of(*self->maker_); });
    done(measures);
  });
}

bool MapRunner::guarded(const std::function<void()>& work) {
  try {
    work();
    return true;
  } catch (const std::exception& problem) {
    // What is half done cannot be undone: the published state stays, and is all that there will be.
    freeze(std::string("internal error in its work: ") + problem.what());
    return false;
  }
}

void MapRunner::freeze(const std::string& why) {
  if (std::exchange(frozen_, true)) return;
  const std::string name = published_ ? published_->name : std::string("not yet made");
  log_->error("the map {} takes nothing until the server starts again: {}", name, why);
  if (listener_.frozen) listener_.frozen(why);
}

Result<SeedResult> MapRunner::make_map(SeedJob* job) {
  if (is_withdrawn(job->pending)) return fail(ErrorCode::kRefused, kSeedWithdrawn);
  for (auto [message, image] : {std::pair{&job->first_image, &job->input.first_image},
                                std::pair{&job->second_image, &job->input.second_image}}) {
    Result<GrayImagePtr> decoded = decode_image(*message);
    if (!decoded) return tl::unexpected(decoded.error());
    if (Status fits = check_image_size(**decoded, *job->input.camera); !fits)
      return tl::unexpected(std::move(fits.error()));
    *image = std::move(*decoded);
  }
  auto started = MapMaker::start(job->input, options_);
  if (!started) return tl::unexpected(started.error());
  maker_ = std::move(started->first);
  return std::move(started->second);
}

void MapRunner::offer(OfferJob job, OfferDone done) {
  ++waiting_offers_;
  const MonotonicTime arrival = clock_->now();
  auto take = [self = shared_from_this(), job = std::move(job), done = std::move(done), arrival]() mutable {
    --self->waiting_offers_;
    if (job.reference_command == 0 || self->maker_ == nullptr || self->deleted_ || self->frozen_)
      return self->decide(std::move(job), arrival, std::move(done));
    self->chained_.push_back({std::move(job), arrival, std::move(done)});
    if (self->chained_.size() == 1) self->take_next_of_chain();
  };
  queue_.post(std::move(take), Urgency::kUrgent);
}

/// Takes the offers of a chain one after another: each was tracked on what the one before it brought, and the
/// points of that are made first.
void MapRunner::take_next_of_chain() {
  finish_all_work(kStepsOnly, [self = shared_from_this()] {
    WaitingOffer next = std::move(self->chained_.front());
    self->decide(std::move(next.job), next.arrival, std::move(next.done));
    self->chained_.pop_front();
    if (!self->chained_.empty()) self->take_next_of_chain();
  });
}

void MapRunner::decide(OfferJob job, MonotonicTime arrival, OfferDone done) {
  const bool lockstep = job.lockstep;
  const JobOrigin origin = job.origin;
  OfferJudgement judgement{wire::OfferDecision::kDamaged, kInternalError, {}, {}};
  guarded([&] { judgement = judge(std::move(job), arrival); });
  const bool accepted = judgement.decision == wire::OfferDecision::kAccepted;
  if (!accepted || !lockstep) {
    answer_offer(origin, std::move(judgement), std::move(done));
    if (accepted) schedule_upkeep();
    return;
  }
  finish_in_lockstep([self = shared_from_this(), origin, judgement = std::move(judgement),
                      done = std::move(done)] { self->answer_offer(origin, judgement, done); });
}

void MapRunner::answer_offer(const JobOrigin& origin, OfferJudgement judgement, OfferDone done) {
  const OfferJudgement failed{wire::OfferDecision::kDamaged, kInternalError, {}, {}};
  if (judgement.decision == wire::OfferDecision::kAccepted) {
    if (has_ended()) {
      judgement = ended();
    } else if (frozen_ || !guarded([this] { publish(); })) {
      judgement = failed;
    }
  }
  if (published_ != nullptr) judgement.revision = published_->revision;
  if (guarded([&] { keep_offer(origin, judgement, done); })) return;
  judgement = failed;
  if (published_ != nullptr) judgement.revision = published_->revision;
  done(std::move(judgement));
}

OfferJudgement MapRunner::ended() const {
  if (deleted_) return {wire::OfferDecision::kUnknownMap, kDeleted, {}, {}};
  return {wire::OfferDecision::kStale, "another state of the map has taken its place", {}, {}};
}

/// Refers an offer to a keyframe of the map. It was tracked while its client was cut off, and its pose is
/// relative to the frame of an earlier offer. False if nothing is known of that one.
bool MapRunner::refer_to_earlier(OfferJob* job) const {
  const OfferChain::Link* link =
      chain_.find(job->origin.client, job->origin.command.session, job->reference_command);
  if (link == nullptr) return false;
  job->input.reference = link->keyframe;
  job->input.camera_from_reference = job->input.camera_from_reference * link->camera_from_keyframe;
  job->input.is_chained = true;
  return true;
}

OfferJudgement MapRunner::judge(OfferJob job, MonotonicTime arrival) {
  using wire::OfferDecision;
  if (has_ended()) return ended();
  if (is_withdrawn(job.pending)) {
    return {OfferDecision::kNoRight,
            "what this client may add to the map has changed while its keyframe waited",
            {},
            {}};
  }
  if (maker_ == nullptr) return {OfferDecision::kUnknownMap, "this map was not made", {}, {}};
  if (frozen_) return {OfferDecision::kDamaged, kInternalError, {}, {}};
  if (!carry_over(epochs_, job.epoch, published_->epoch, &job.input)) {
    return {OfferDecision::kStale, "the map has entered another epoch since the frame was taken", {}, {}};
  }
  if (job.reference_command != 0 && !refer_to_earlier(&job)) {
    return {OfferDecision::kStale, "the offer that its pose is relative to is not in this map", {}, {}};
  }
  const JobOrigin origin = job.origin;
  // Whether its pose is right or not, and whatever becomes of it: the next frame of the chain is judged by
  // what it shows itself.
  const bool is_of_chain = origin.proposal == 0;  // its session may be over, and another's chain under way
  if (is_of_chain) {
    chain_.put(origin.client, origin.command.session, origin.command.seq,
               {job.input.reference, job.input.camera_from_reference});
  }
  if (std::string why = store_ ? store_->trouble() : ""; !why.empty()) {
    return {OfferDecision::kFull, std::move(why), {}, {}};
  }
  if (times_ != nullptr) times_->waited(clock_->now() - arrival);
  const auto before = thread_cpu_time();
  KeyframeDecision decision =
      maker_->add_keyframe(job.input, [&message = job.image] { return decode_image(message); });
  if (decision.verdict == KeyframeVerdict::kAccepted) {
    ++changes_;
    if (is_of_chain)
      chain_.put(origin.client, origin.command.session, origin.command.seq, {decision.keyframe, SE3()});
  }
  if (times_ != nullptr) {
    times_->judged(thread_cpu_time() - before);
    if (decision.verdict == KeyframeVerdict::kAccepted) {
      arrivals_.emplace(decision.keyframe, arrival);
      offered_.push_back(arrival);
    }
  }
  return {to_decision(decision.verdict), std::move(decision.reason), decision.keyframe, {}};
}

StepReport MapRunner::step(const std::function<bool()>& should_yield) {
  const auto before = thread_cpu_time();
  const StepReport report = maker_->step(should_yield);
  if (times_ == nullptr || report.work == MapWork::kNone) return report;
  auto& spent = spent_[report.work];
  spent += thread_cpu_time() - before;
  if (report.finished) times_->worked(report, std::exchange(spent, {}));
  if (const auto offer = arrivals_.extract(report.keyframe)) pointed_.push_back(offer.mapped());
  return report;
}

void MapRunner::schedule_upkeep() {
  if (stopping_ || frozen_ || std::exchange(upkeep_scheduled_, true)) return;
  queue_.post([self = shared_from_this()] { self->guarded([&] { self->do_upkeep(); }); });
}

void MapRunner::do_upkeep() {
  upkeep_scheduled_ = false;
  if (stopping_ || frozen_ || lockstep_jobs_ > 0) return;
  if (needs_images()) return page_in([self = shared_from_this()] { self->schedule_upkeep(); });
  // Posted behind the offers that wait, so these are next in either case; yielding only shortens their wait.
  const StepReport report =
      step([this] { return stopping_ || waiting_offers_ > 0 || urgent_.urgent_waits(); });
  if (report.changed) publish();
  if (report.work != MapWork::kNone) {
    schedule_upkeep();
  } else if (!adjusting_globally_ && maker_->wants_global_adjustment()) {
    begin_global_adjustment();
  }
}

void MapRunner::begin_global_adjustment() {
  adjusting_globally_ = true;
  adjust_globally(&background_, [this](bool adopted) {
    adjusting_globally_ = false;
    if (!adopted) return;
    guarded([this] { publish(); });
    schedule_upkeep();
  });
}

void MapRunner::adjust_globally(Executor* executor, std::function<void(bool adopted)> then) {
  std::shared_ptr<GlobalAdjustment> problem = maker_->prepare_global_adjustment();
  executor->submit([self = shared_from_this(), problem = std::move(problem), then = std::move(then)] {
    bool solved = false;
    const auto before = thread_cpu_time();
    try {
      solve(problem.get(), [&self] { return self->stopping_.load(); });
      solved = true;
    } catch (const std::exception& error) {
      self->log_->error("internal error in a global adjustment, passed over: {}", error.what());
    }
    const auto cpu = thread_cpu_time() - before;
    self->queue_.post([self, problem, solved, cpu, then] {
      then(solved && !self->stopping_ && !self->frozen_ && self->guarded([&] {
        const StepReport report = self->maker_->adopt(*problem);
        if (self->times_ != nullptr) self->times_->worked(report, cpu);
      }));
    });
  });
}

/// Upkeep leaves all work to it: that yields, and adjusts in the background, when the machine's time has it.
void MapRunner::finish_in_lockstep(std::function<void()> then) {
  ++lockstep_jobs_;
  finish_all_work(0, [self = shared_from_this(), then = std::move(then)] {
    --self->lockstep_jobs_;
    then();
  });
}

void MapRunner::finish_all_work(int adjustments, std::function<void()> then) {
  queue_.post([self = shared_from_this(), adjustments, then = std::move(then)]() mutable {
    if (self->needs_images() && self->guarded([&] {
          self->page_in([self, adjustments, then] { self->finish_all_work(adjustments, then); });
        }))
      return;
    // To its end, whoever waits: where a step is cut decides what comes of it.
    MapWork done = MapWork::kNone;
    if (!self->frozen_ && !self->stopping_)
      self->guarded([&] { done = self->step([&] { return self->stopping_.load(); }).work; });
    if (done != MapWork::kNone) return self->finish_all_work(adjustments, std::move(then));
    self->adjust_in_lockstep(adjustments, std::move(then));
  });
}

void MapRunner::adjust_in_lockstep(int adjustments, std::function<void()> then) {
  if (frozen_ || stopping_ || adjustments == kStepsOnly || !maker_->wants_global_adjustment()) return then();
  if (adjustments == kMaxLockstepRounds) {
    log_->debug("lockstep: the map maker still wants a global adjustment after {}", adjustments);
    return then();
  }
  // Somebody waits for it: at a nice value it would stand still on a busy machine.
  const bool begun = guarded([&] {
    adjust_globally(&urgent_, [this, adjustments, then](bool) { finish_all_work(adjustments + 1, then); });
  });
  if (!begun) then();
}

void MapRunner::publish() {
  MapSnapshotPtr snapshot = maker_->snapshot();
  if (published_ != nullptr && snapshot->epoch == published_->epoch &&
      snapshot->revision == published_->revision)
    return;
  listener_.changed(
      {snapshot, maker_->statistics(), maker_->keyframe_views(), {}, std::exchange(offered_, {})});
  published_ = std::move(snapshot);
  for (const MonotonicTime arrival : std::exchange(pointed_, {}))
    times_->points_published(clock_->now() - arrival);
  save_soon();
}

}  // namespace cairn
