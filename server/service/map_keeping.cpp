// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <chrono>
#include <utility>

#include "common/base/utf8.h"
#include "server/service/map_runner.h"

/// A map's way into the store.
namespace cairn {
namespace {

DecisionRecord record_of(const JobOrigin& origin, CommandKind kind, Timestamp now) {
  DecisionRecord record;
  record.client = origin.client;
  record.session = origin.command.session;
  record.seq = origin.command.seq;
  record.kind = kind;
  record.time = now;
  return record;
}

}  // namespace

void MapRunner::keep_seed(const SeedJob& job, const SeedResult& result, const SeedDone& done) {
  epochs_ = {{job.input.epoch, 0, 0}};
  if (store_ == nullptr) return done(result, published_);
  MapUpdate whole = take_update();
  DecisionRecord decision = record_of(job.origin, CommandKind::kSeed, clock_->wall());
  decision.keyframe = result.second_keyframe;
  decision.seed_points = result.points;
  whole.decisions.push_back(std::move(decision));
  MapHeader header{job.input.map, job.input.map_name, job.input.epoch, false, clock_->wall()};
  store_->create(std::move(header), std::move(whole),
                 [self = shared_from_this(), result, snapshot = published_, done](const Status& kept) {
                   if (kept) return done(result, snapshot);
                   self->stopping_ = true;  // a map that is not kept was never made
                   done(tl::unexpected(kept.error()), nullptr);
                 });
}

void MapRunner::keep_offer(const JobOrigin& origin, const OfferJudgement& judgement, const OfferDone& done) {
  if (store_ == nullptr || maker_ == nullptr || frozen_ || has_ended()) return done(judgement);
  const bool is_accepted = judgement.decision == wire::OfferDecision::kAccepted;
  if (origin.proposal != 0 && !is_accepted) return done(judgement);  // its client has had its answer
  DecisionRecord decision = record_of(origin, CommandKind::kOffer, clock_->wall());
  // Its client's newest session is told by the times of decisions, and may be another by now.
  if (origin.proposal != 0) decision.time = origin.proposed;
  decision.decision = static_cast<uint8_t>(judgement.decision);
  decision.reason = judgement.reason;
  decision.keyframe = judgement.keyframe;
  if (!is_accepted) {
    refusals_.push_back(std::move(decision));
    save_soon();
    return done(judgement);
  }
  MapUpdate update = take_update();
  update.decisions.push_back(std::move(decision));
  if (origin.proposal != 0) update.removed_proposals.push_back(origin.proposal);
  store_->write(published_->map, std::move(update),
                [self = shared_from_this(), judgement, done](const Status& kept) {
                  if (kept) return done(judgement);
                  self->on_not_kept(kept.error());
                  if (self->deleted_)
                    return done({wire::OfferDecision::kUnknownMap, kDeleted, {}, judgement.revision});
                  done({wire::OfferDecision::kFull, one_line(kept.error().message), {}, judgement.revision});
                });
}

void MapRunner::on_not_kept(const Error& error) {
  update_lost_ = true;
  if (stopping_ || sqlite::is_write_failure(error)) return;  // the whole store's trouble: it will be over
  ++saves_failed_;
  // No use in trying again: the file is broken, or has been taken away.
  if (error.code != ErrorCode::kDamaged && error.code != ErrorCode::kNotFound) return;
  queue_.post(
      [self = shared_from_this(), why = error.message] { self->freeze("it cannot be kept: " + why); });
}

MapUpdate MapRunner::take_update() {
  ++changes_;
  if (update_lost_.exchange(false)) maker_->keep_everything_anew();
  return {maker_->take_changes(), std::exchange(refusals_, {}), {}, {}};
}

void MapRunner::save_soon() {
  if (store_ == nullptr || stopping_ || frozen_ || std::exchange(save_scheduled_, true)) return;
  store_->later(
      [weak = weak_from_this()] {
        if (const auto self = weak.lock())
          self->queue_.post([self] { self->guarded([&] { self->save(); }); });
      },
      MapPersistence::delay_after(saves_failed_));
}

void MapRunner::save() {
  save_scheduled_ = false;
  if (store_ == nullptr || stopping_ || frozen_ || maker_ == nullptr) return;
  if (!store_->trouble().empty()) return save_soon();  // all images would be packed for nothing
  MapUpdate update = take_update();
  if (update.record.empty() && update.decisions.empty()) return;
  store_->write(published_->map, std::move(update),
                [self = shared_from_this()](const Status& kept) { self->on_saved(kept); });
}

void MapRunner::on_saved(const Status& kept) {
  if (kept) {
    saves_failed_ = 0;
    return;
  }
  on_not_kept(kept.error());
  queue_.post([self = shared_from_this()] { self->save_soon(); });  // until it succeeds
}

void MapRunner::save_last_changes() {
  if (store_ == nullptr || frozen_ || replaced_ || maker_ == nullptr || published_ == nullptr) return;
  MapUpdate update = take_update();
  if (update.record.empty() && update.decisions.empty()) return;
  store_->write(published_->map, std::move(update), {});
}

/// An update that is empty waits for those before it, one of which may fail.
void MapRunner::hand_over(const Kept& then) {
  if (store_ == nullptr || stopping_ || frozen_ || maker_ == nullptr) return then({});
  if (std::string why = store_->trouble(); !why.empty()) {  // all images would be packed for nothing
    save_soon();
    return then(fail(ErrorCode::kIo, std::move(why)));
  }
  const bool is_handed_in = guarded([&] {
    store_->write(published_->map, take_update(), [self = shared_from_this(), then](const Status& kept) {
      self->on_saved(kept);
      if (!kept || !self->update_lost_) return then(kept);
      then(fail(ErrorCode::kIo, "the map's last changes are not kept yet; try again"));
    });
  });
  if (!is_handed_in) then(fail(ErrorCode::kInternal, "internal error; the server's log says more"));
}

void MapRunner::flush(Kept then) {
  queue_.post([self = shared_from_this(), then = std::move(then)] { self->hand_over(then); });
}

void MapRunner::give_way(Kept then) {
  queue_.post([self = shared_from_this(), then = std::move(then)] {
    // The map goes on where a roll-back fails, and then the store has to be brought up to date: on_saved().
    self->hand_over(then);
    self->replaced_ = true;
    self->stopping_ = true;
    if (const auto waiting = self->awaiting_images_.lock()) self->end_reading(waiting);
  });
}

void MapRunner::go_on_after_all() {
  queue_.post([self = shared_from_this()] {
    self->replaced_ = false;
    self->stopping_ = false;
    self->save_soon();
    self->schedule_upkeep();
  });
}

void MapRunner::rename(std::string name, std::function<void(Status)> done) {
  queue_.post([self = shared_from_this(), name = std::move(name), done = std::move(done)] {
    if (self->has_ended()) return done(fail(ErrorCode::kRefused, self->ended().reason));
    if (self->maker_ == nullptr || self->frozen_)
      return done(fail(ErrorCode::kRefused,
                       "the map's work has failed; it takes nothing until the server starts again"));
    const auto show = [self, name, done] {
      self->guarded([&] {
        self->maker_->rename(name);
        self->publish();
      });
      done({});
    };
    if (self->store_ == nullptr) return show();
    // Nobody sees a name that is not kept.
    self->store_->run([self, map = self->published_->map, name, show, done](Store& store) {
      const Status kept = store.rename(map, name);
      if (!kept) return done(kept);
      self->queue_.post(show);
    });
  });
}

}  // namespace cairn
