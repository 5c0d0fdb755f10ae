// SPDX-License-Identifier: Apache-2.0
#include "server/service/command_gate.h"

#include <algorithm>
#include <utility>

namespace cairn {

void OfferGate::enter_session(SessionId session) {
  if (session != session_) *this = OfferGate();
  session_ = session;
}

void OfferGate::resume(SessionId session, std::vector<wire::OfferOutcome> decided) {
  enter_session(session);
  if (decided.empty()) return;
  const uint64_t last = decided.back().seq;
  last_decided_ = last > kCredit ? last - kCredit : 0;
  for (wire::OfferOutcome& outcome : decided) {
    if (outcome.seq > last_decided_) {
      decide(session, std::move(outcome));
    } else {
      recent_.push_back(std::move(outcome));
    }
  }
  while (recent_.size() > kRecent) recent_.pop_front();
}

OfferGate::Admission OfferGate::admit(uint64_t seq) {
  if (!has_admitted_ && seq > last_decided_ + 1 && is_lowest_wanted(seq)) {
    last_decided_ = seq - 1;
    decided_ahead_.erase(decided_ahead_.begin(), decided_ahead_.lower_bound(seq));
    close_ranks();
  }
  if (seq <= last_decided_ || decided_ahead_.contains(seq)) return Admission::kRepeated;
  last_admitted_ = std::max(last_admitted_, last_decided_);
  while (decided_ahead_.contains(last_admitted_ + 1)) ++last_admitted_;
  if (seq <= last_admitted_) return Admission::kInFlight;
  if (seq != last_admitted_ + 1 || seq > last_decided_ + kMaxAhead) return Admission::kGap;
  last_admitted_ = seq;
  has_admitted_ = true;
  return seq > last_decided_ + kCredit ? Admission::kNoCredit : Admission::kNew;
}

bool OfferGate::is_lowest_wanted(uint64_t seq) {
  if (times_seen_ == 0 || seq < lowest_seen_) {
    lowest_seen_ = seq;
    times_seen_ = 0;
  }
  return seq == lowest_seen_ && ++times_seen_ >= kSentAgain;
}

void OfferGate::decide(SessionId session, wire::OfferOutcome outcome) {
  if (session != session_) return;
  const uint64_t seq = outcome.seq;
  decided_ahead_.insert_or_assign(seq, std::move(outcome));
  close_ranks();
}

void OfferGate::close_ranks() {
  while (!decided_ahead_.empty() && decided_ahead_.begin()->first == last_decided_ + 1) {
    recent_.push_back(std::move(decided_ahead_.begin()->second));
    if (recent_.size() > kRecent) recent_.pop_front();
    decided_ahead_.erase(decided_ahead_.begin());
    ++last_decided_;
  }
}

wire::OfferVerdict OfferGate::verdict(ClientId client) const {
  return {client, session_, last_decided_, kCredit, {recent_.begin(), recent_.end()}};
}

void SeedGate::enter_session(SessionId session) {
  if (session != session_) *this = SeedGate();
  session_ = session;
}

void SeedGate::resume(const wire::SeedVerdict& verdict) {
  enter_session(verdict.command.session);
  newest_ = verdict.command.seq;
  verdict_ = verdict;
}

SeedGate::Admission SeedGate::admit(uint64_t seq) {
  if (seq == 0 || seq < newest_) return Admission::kSuperseded;
  if (seq == newest_) return verdict_.command.seq == seq ? Admission::kRepeated : Admission::kInFlight;
  newest_ = seq;
  return Admission::kNew;
}

bool SeedGate::decide(const wire::SeedVerdict& verdict) {
  if (verdict.command.session != session_ || verdict.command.seq != newest_) return false;
  verdict_ = verdict;
  return true;
}

}  // namespace cairn
