// SPDX-License-Identifier: Apache-2.0
#include "client/session/spool.h"

#include <algorithm>
#include <utility>

namespace cairn {

void ResendTimer::sent(MonotonicTime now) {
  next_ = now + wait_;
  wait_ = std::min(2 * wait_, kLongestResend);
}

void ResendTimer::send_at_once() {
  *this = ResendTimer();
}

std::optional<OfferReply> Spool::push(SpooledOffer offer) {
  std::optional<OfferReply> lost;
  if (entries_.size() >= limit_) {
    lost = OfferReply{0, false, "spool full: the oldest offer not yet sent was dropped"};
    const auto unsent =
        std::find_if(entries_.begin(), entries_.end(), [](const Entry& e) { return e.seq == 0; });
    if (unsent == entries_.end()) return lost;
    entries_.erase(unsent);
  }
  entries_.push_back({0, std::make_shared<const SpooledOffer>(std::move(offer)), {}});
  return lost;
}

std::optional<Spool::Sendable> Spool::next(MonotonicTime now) {
  for (Entry& entry : entries_) {
    if (entry.seq == 0) {
      if (last_seq_ + 1 > last_decided_ + credit_) return std::nullopt;
      entry.seq = ++last_seq_;
    }
    if (entry.timer.due(now)) {
      entry.timer.sent(now);
      return Sendable{{session_, entry.seq}, entry.offer};
    }
  }
  return std::nullopt;
}

std::vector<OfferReply> Spool::apply(const wire::OfferVerdict& verdict) {
  std::vector<OfferReply> replies;
  if (verdict.session != session_) return replies;
  credit_ = verdict.credit;
  last_decided_ = std::max(last_decided_, std::min(verdict.last_decided, last_seq_));
  while (!entries_.empty() && entries_.front().seq != 0 && entries_.front().seq <= last_decided_) {
    OfferReply reply{entries_.front().seq, false, "decided; the reason was missed"};
    const auto outcome = std::find_if(verdict.recent.begin(), verdict.recent.end(),
                                      [&](const wire::OfferOutcome& o) { return o.seq == reply.seq; });
    if (outcome != verdict.recent.end()) {
      reply.accepted = outcome->decision == wire::OfferDecision::kAccepted;
      reply.reason = outcome->reason;
    }
    replies.push_back(std::move(reply));
    entries_.pop_front();
  }
  return replies;
}

void Spool::resend_all() {
  for (Entry& entry : entries_) entry.timer.send_at_once();
}

std::vector<OfferReply> Spool::restart(SessionId session, const std::string& reason) {
  std::vector<OfferReply> replies;
  for (const Entry& entry : entries_) replies.push_back({entry.seq, false, reason});
  *this = Spool(limit_, session);
  return replies;
}

void SeedSlot::put(SeedProposal proposal) {
  proposal_ = std::make_shared<const SeedProposal>(std::move(proposal));
  ++seq_;
  timer_.send_at_once();
}

std::optional<SeedSlot::Sendable> SeedSlot::next(MonotonicTime now) {
  if (proposal_ == nullptr || !timer_.due(now)) return std::nullopt;
  timer_.sent(now);
  return Sendable{{session_, seq_}, proposal_};
}

bool SeedSlot::apply(const wire::SeedVerdict& verdict) {
  if (proposal_ == nullptr || verdict.command != wire::CommandId{session_, seq_}) return false;
  proposal_.reset();
  return true;
}

void SeedSlot::resend() {
  timer_.send_at_once();
}

void SeedSlot::restart(SessionId session) {
  session_ = session;
  seq_ = proposal_ == nullptr ? 0 : 1;
  timer_.send_at_once();
}

void QuestionSlot::put(PlaceQuestionSent question) {
  question_ = std::make_shared<const PlaceQuestionSent>(std::move(question));
  ++seq_;
  timer_.send_at_once();
}

std::optional<QuestionSlot::Sendable> QuestionSlot::next(MonotonicTime now) {
  if (question_ == nullptr || !timer_.due(now)) return std::nullopt;
  timer_.sent(now);
  return Sendable{{session_, seq_}, question_};
}

bool QuestionSlot::apply(const wire::RelocAnswer& answer) {
  if (question_ == nullptr || answer.command != wire::CommandId{session_, seq_}) return false;
  question_.reset();
  return true;
}

void QuestionSlot::restart(SessionId session) {
  session_ = session;
  question_.reset();
}

}  // namespace cairn
