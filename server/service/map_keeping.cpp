// SPDX-License-Identifier: Apache-2.0
#include <chrono>
#include <utility>

#include "server/service/map_runner.h"

/// A map's way into the store.
namespace cairn {
namespace {

Timestamp now() {
  return {std::chrono::duration_cast<std::chrono::nanoseconds>(
              std::chrono::system_clock::now().time_since_epoch())
              .count()};
}

DecisionRecord record_of(const JobOrigin& origin, CommandKind kind) {
  DecisionRecord record;
  record.client = origin.client;
  record.session = origin.command.session;
  record.seq = origin.command.seq;
  record.kind = kind;
  record.time = now();
  return record;
}

}  // namespace

void MapRunner::keep_seed(const SeedJob& job, const SeedResult& result, SeedDone done) {
  epochs_ = {{job.input.epoch, 0, 0}};
  if (store_ == nullptr) return done(result, published_);
  MapUpdate whole = take_update();
  DecisionRecord decision = record_of(job.origin, CommandKind::kSeed);
  decision.keyframe = result.second_keyframe;
  decision.seed_points = result.points;
  whole.decisions.push_back(std::move(decision));
  MapHeader header{job.input.map, job.input.map_name, job.input.epoch, false, now()};
  store_->create(
      std::move(header), std::move(whole),
      [self = shared_from_this(), result, snapshot = published_, done = std::move(done)](const Status& kept) {
        if (kept) return done(result, snapshot);
        self->stopping_ = true;  // a map that is not kept was never made
        done(tl::unexpected(kept.error()), nullptr);
      });
}

void MapRunner::keep_offer(JobOrigin origin, OfferJudgement judgement, OfferDone done) {
  if (store_ == nullptr || maker_ == nullptr || frozen_) return done(std::move(judgement));
  DecisionRecord decision = record_of(origin, CommandKind::kOffer);
  decision.decision = static_cast<uint8_t>(judgement.decision);
  decision.reason = judgement.reason;
  decision.keyframe = judgement.keyframe;
  if (judgement.decision != wire::OfferDecision::kAccepted) {
    refusals_.push_back(std::move(decision));
    save_soon();
    return done(std::move(judgement));
  }
  MapUpdate update = take_update();
  update.decisions.push_back(std::move(decision));
  store_->write(published_->map, std::move(update),
                [self = shared_from_this(), judgement = std::move(judgement),
                 done = std::move(done)](const Status& kept) mutable {
                  if (!kept) {
                    self->update_lost_ = true;
                    judgement = {wire::OfferDecision::kFull, kept.error().message, {}, judgement.revision};
                  }
                  done(std::move(judgement));
                });
}

MapUpdate MapRunner::take_update() {
  if (update_lost_.exchange(false)) maker_->keep_everything_anew();
  return {maker_->take_changes(), std::exchange(refusals_, {}), {}, {}};
}

void MapRunner::save_soon() {
  if (store_ == nullptr || stopping_ || std::exchange(save_scheduled_, true)) return;
  store_->later([weak = weak_from_this()] {
    if (const auto self = weak.lock()) self->queue_.post([self] { self->guarded([&] { self->save(); }); });
  });
}

void MapRunner::save() {
  save_scheduled_ = false;
  if (stopping_ || frozen_ || maker_ == nullptr) return;
  MapUpdate update = take_update();
  if (update.record.empty() && update.decisions.empty()) return;
  store_->write(published_->map, std::move(update), [self = shared_from_this()](const Status& kept) {
    if (kept) return;
    self->update_lost_ = true;
    self->queue_.post([self] { self->save_soon(); });  // until it succeeds
  });
}

void MapRunner::save_last_changes() {
  if (store_ == nullptr || frozen_ || maker_ == nullptr || published_ == nullptr) return;
  store_->write(published_->map, take_update(), {});
}

}  // namespace cairn
