// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_runner.h"

#include <cstring>
#include <exception>
#include <utility>

#include "common/io/image_file.h"
#include "server/service/resume.h"

namespace cairn {
namespace {

/// Rounds of "upkeep, then global adjustment" after which a lockstep job is answered even if the map maker
/// wants more: the same number on every run, so the answer is still reproducible.
constexpr int kMaxLockstepRounds = 8;

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
    case KeyframeVerdict::kFull:
      return wire::OfferDecision::kFull;
    case KeyframeVerdict::kDamaged:
      break;
  }
  return wire::OfferDecision::kDamaged;
}

bool fits(const GrayImage& image, const Camera& camera) {
  return image.width() == camera.width() && image.height() == camera.height();
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

MapRunner::MapRunner(Lanes lanes, const MapMakerOptions& options, MapPersistence* store, Changed changed,
                     Logger log)
    : background_(lanes.background),
      queue_(lanes.urgent),
      options_(options),
      store_(store),
      changed_(std::move(changed)),
      log_(std::move(log)) {}

void MapRunner::start(SeedJob job, SeedDone done) {
  queue_.post([self = shared_from_this(), job = std::move(job), done = std::move(done)]() mutable {
    Result<SeedResult> result = fail(ErrorCode::kInternal, kInternalError);
    self->guarded([&] {
      Result<SeedResult> made = self->make_map(&job);
      if (made && job.lockstep) self->finish_all_work();
      if (made) self->publish();
      result = std::move(made);
    });
    if (!result) return done(std::move(result), nullptr);
    self->keep_seed(job, *result, std::move(done));
    if (!job.lockstep) self->schedule_upkeep();
  });
}

void MapRunner::resume(RestoredMap restored) {
  maker_ = std::move(restored.maker);
  epochs_ = std::move(restored.epochs);
  publish();
  schedule_upkeep();
}

void MapRunner::guarded(const std::function<void()>& work) {
  try {
    work();
  } catch (const std::exception& problem) {
    // What is half done cannot be undone: the published state stays, and is all that there will be.
    log_->error("internal error in a map's work, the map is frozen: {}", problem.what());
    frozen_ = true;
  }
}

Result<SeedResult> MapRunner::make_map(SeedJob* job) {
  for (auto [message, image] : {std::pair{&job->first_image, &job->input.first_image},
                                std::pair{&job->second_image, &job->input.second_image}}) {
    Result<GrayImagePtr> decoded = decode_image(*message);
    if (!decoded) return tl::unexpected(decoded.error());
    if (!fits(**decoded, *job->input.camera)) {
      return fail(ErrorCode::kDamaged, "the images are not of the camera's size");
    }
    *image = std::move(*decoded);
  }
  auto started = MapMaker::start(job->input, options_);
  if (!started) return tl::unexpected(started.error());
  maker_ = std::move(started->first);
  return std::move(started->second);
}

void MapRunner::offer(OfferJob job, OfferDone done) {
  ++waiting_offers_;
  queue_.post([self = shared_from_this(), job = std::move(job), done = std::move(done)]() mutable {
    --self->waiting_offers_;
    const bool lockstep = job.lockstep;
    JobOrigin origin = std::move(job.origin);
    OfferJudgement judgement{wire::OfferDecision::kDamaged, kInternalError, {}, {}};
    self->guarded([&] {
      OfferJudgement judged = self->judge(std::move(job));
      const bool taken = judged.decision == wire::OfferDecision::kAccepted;
      if (taken && lockstep) self->finish_all_work();
      if (taken) self->publish();
      judgement = std::move(judged);
    });
    const bool accepted = judgement.decision == wire::OfferDecision::kAccepted;
    if (self->published_ != nullptr) judgement.revision = self->published_->revision;
    self->keep_offer(std::move(origin), std::move(judgement), std::move(done));
    if (accepted && !lockstep) self->schedule_upkeep();
  });
}

OfferJudgement MapRunner::judge(OfferJob job) {
  using wire::OfferDecision;
  if (maker_ == nullptr) return {OfferDecision::kUnknownMap, "this map was not made", {}, {}};
  if (frozen_) return {OfferDecision::kDamaged, kInternalError, {}, {}};
  if (!carry_over(epochs_, job.epoch, published_->epoch, &job.input)) {
    return {OfferDecision::kStale, "the map has entered another epoch since the frame was taken", {}, {}};
  }
  if (std::string why = store_ ? store_->trouble() : ""; !why.empty()) {
    return {OfferDecision::kFull, std::move(why), {}, {}};
  }
  Result<GrayImagePtr> image = decode_image(job.image);
  if (!image) return {OfferDecision::kDamaged, image.error().message, {}, {}};
  if (!fits(**image, *job.input.camera)) {
    return {OfferDecision::kDamaged, "the image is not of the camera's size", {}, {}};
  }
  job.input.image = std::move(*image);
  KeyframeDecision decision = maker_->add_keyframe(job.input);
  return {to_decision(decision.verdict), std::move(decision.reason), decision.keyframe, {}};
}

void MapRunner::schedule_upkeep() {
  if (stopping_ || frozen_ || std::exchange(upkeep_scheduled_, true)) return;
  queue_.post([self = shared_from_this()] { self->guarded([&] { self->do_upkeep(); }); });
}

void MapRunner::do_upkeep() {
  upkeep_scheduled_ = false;
  if (stopping_ || frozen_) return;
  // Posted behind the offers that wait, so these are next in either case; yielding only shortens their wait.
  const StepReport report = maker_->step([this] { return stopping_ || waiting_offers_ > 0; });
  if (report.changed) publish();
  if (report.work != MapWork::kNone) {
    schedule_upkeep();
  } else if (!adjusting_globally_ && maker_->wants_global_adjustment()) {
    begin_global_adjustment();
  }
}

void MapRunner::begin_global_adjustment() {
  adjusting_globally_ = true;
  std::shared_ptr<GlobalAdjustment> problem = maker_->prepare_global_adjustment();
  background_.submit([self = shared_from_this(), problem = std::move(problem)] {
    bool solved = false;
    try {
      solve(problem.get(), [&self] { return self->stopping_.load(); });
      solved = true;
    } catch (const std::exception& error) {
      self->log_->error("internal error in a global adjustment, passed over: {}", error.what());
    }
    self->queue_.post([self, problem, solved] {
      self->adjusting_globally_ = false;
      if (!solved || self->stopping_ || self->frozen_) return;
      self->guarded([&] {
        if (self->maker_->adopt(*problem).changed) self->publish();
        self->schedule_upkeep();
      });
    });
  });
}

void MapRunner::finish_all_work() {
  for (int round = 0; round < kMaxLockstepRounds; ++round) {
    while (!stopping_ && maker_->step([this] { return stopping_.load(); }).work != MapWork::kNone) {
    }
    if (stopping_ || !maker_->wants_global_adjustment()) return;
    const GlobalAdjustmentPtr problem = maker_->prepare_global_adjustment();
    solve(problem.get(), [this] { return stopping_.load(); });
    maker_->adopt(*problem);
  }
  log_->debug("lockstep: the map maker still wants a global adjustment after {} rounds", kMaxLockstepRounds);
}

void MapRunner::publish() {
  MapSnapshotPtr snapshot = maker_->snapshot();
  if (published_ != nullptr && snapshot->revision == published_->revision) return;
  changed_(snapshot, maker_->statistics(), maker_->keyframe_views());
  published_ = std::move(snapshot);
  save_soon();
}

}  // namespace cairn
