// SPDX-License-Identifier: Apache-2.0
#include "server/service/command_gate.h"

#include <utility>

namespace cairn {

void OfferGate::enter_session(SessionId session) {
  if (session != session_) *this = OfferGate();
  session_ = session;
}

OfferGate::Admission OfferGate::admit(uint64_t seq) {
  if (seq <= last_decided_ || decided_ahead_.contains(seq)) return Admission::kRepeated;
  if (seq <= last_admitted_) return Admission::kInFlight;
  if (seq != last_admitted_ + 1 && !is_resumed(seq)) return Admission::kGap;
  if (seq > last_decided_ + kMaxAhead) return Admission::kGap;
  last_admitted_ = seq;
  return seq > last_decided_ + kCredit ? Admission::kNoCredit : Admission::kNew;
}

bool OfferGate::is_resumed(uint64_t seq) {
  if (last_admitted_ != 0) return false;
  if (times_seen_ == 0 || seq < lowest_seen_) {
    lowest_seen_ = seq;
    times_seen_ = 0;
  }
  if (seq != lowest_seen_ || ++times_seen_ < kSentAgain) return false;
  last_decided_ = seq - 1;
  return true;
}

void OfferGate::decide(SessionId session, wire::OfferOutcome outcome) {
  if (session != session_) return;
  const uint64_t seq = outcome.seq;
  decided_ahead_.insert_or_assign(seq, std::move(outcome));
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
