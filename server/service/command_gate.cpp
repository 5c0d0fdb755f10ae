// SPDX-License-Identifier: Apache-2.0
#include "server/service/command_gate.h"

#include <algorithm>
#include <utility>

namespace cairn {

template <typename Verdict>
void CommandGate<Verdict>::enter_session(SessionId session) {
  if (session != session_) *this = CommandGate();
  session_ = session;
}

template <typename Verdict>
void CommandGate<Verdict>::resume(SessionId session, std::vector<Outcome> decided) {
  enter_session(session);
  if (decided.empty()) return;
  const uint64_t last = decided.back().seq;
  last_decided_ = last > kCredit ? last - kCredit : 0;
  for (Outcome& outcome : decided) {
    if (outcome.seq > last_decided_) {
      decide(session, std::move(outcome));
    } else {
      recent_.push_back(std::move(outcome));
    }
  }
  while (recent_.size() > kRecent) recent_.pop_front();
}

template <typename Verdict>
typename CommandGate<Verdict>::Admission CommandGate<Verdict>::admit(uint64_t seq) {
  last_admitted_ = std::max(last_admitted_, last_decided_);
  const bool is_idle = last_admitted_ == last_decided_;
  if (is_idle && seq > last_decided_ + 1 && is_lowest_wanted(seq)) {
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
  times_seen_ = 0;
  return seq > last_decided_ + kCredit ? Admission::kNoCredit : Admission::kNew;
}

template <typename Verdict>
bool CommandGate<Verdict>::is_lowest_wanted(uint64_t seq) {
  const bool is_forgotten = times_seen_ == 0 || seen_since_ >= kSentAgain * static_cast<int>(kCredit);
  if (is_forgotten || seq < lowest_seen_) {
    lowest_seen_ = seq;
    times_seen_ = 0;
  }
  if (seq != lowest_seen_) {
    ++seen_since_;
    return false;
  }
  seen_since_ = 0;
  return ++times_seen_ >= (has_admitted_ ? kSentOften : kSentAgain);
}

template <typename Verdict>
void CommandGate<Verdict>::decide(SessionId session, Outcome outcome) {
  if (session != session_) return;
  const uint64_t seq = outcome.seq;
  decided_ahead_.insert_or_assign(seq, std::move(outcome));
  close_ranks();
}

template <typename Verdict>
void CommandGate<Verdict>::close_ranks() {
  while (!decided_ahead_.empty() && decided_ahead_.begin()->first == last_decided_ + 1) {
    recent_.push_back(std::move(decided_ahead_.begin()->second));
    if (recent_.size() > kRecent) recent_.pop_front();
    decided_ahead_.erase(decided_ahead_.begin());
    ++last_decided_;
  }
}

template <typename Verdict>
Verdict CommandGate<Verdict>::verdict(ClientId client) const {
  return {client, session_, last_decided_, kCredit, {recent_.begin(), recent_.end()}};
}

template class CommandGate<wire::OfferVerdict>;
template class CommandGate<wire::ClientReply>;

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
