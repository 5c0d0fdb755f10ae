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

OfferReply OfferTopic::reply(const Item& item, uint64_t seq, bool done, std::string reason) {
  return {seq, done, std::move(reason), {}, {}, item.proposal.number, false};
}

OfferReply OfferTopic::reply(const Item& item, const wire::OfferOutcome& outcome) {
  return {outcome.seq,
          outcome.decision == wire::OfferDecision::kAccepted,
          outcome.reason,
          outcome.keyframe,
          item.time,
          item.proposal.number,
          outcome.decision == wire::OfferDecision::kKeptAside};
}

RequestReply RequestTopic::reply(const Item& /*item*/, uint64_t seq, bool done, std::string reason) {
  return {seq, done, std::move(reason), {}, {}};
}

RequestReply RequestTopic::reply(const Item& /*item*/, const wire::RequestOutcome& outcome) {
  return {outcome.seq, outcome.decision == wire::RequestDecision::kDone, outcome.reason, outcome.map,
          outcome.label};
}

template <typename Topic>
std::optional<typename Topic::Reply> CommandSpool<Topic>::push(Item item) {
  std::optional<Reply> lost;
  if (entries_.size() >= limit_) {
    const auto unsent =
        std::find_if(entries_.begin(), entries_.end(), [](const Entry& e) { return e.seq == 0; });
    if (unsent == entries_.end())
      return Topic::reply(item, 0, false, "spool full, all of it under way: the newest was dropped");
    lost = Topic::reply(*unsent->item, 0, false, "spool full: the oldest not yet sent was dropped");
    entries_.erase(unsent);
  }
  entries_.push_back({0, std::make_shared<const Item>(std::move(item)), {}});
  return lost;
}

template <typename Topic>
std::optional<typename CommandSpool<Topic>::Sendable> CommandSpool<Topic>::next(MonotonicTime now) {
  for (Entry& entry : entries_) {
    if (entry.seq == 0) {
      if (last_seq_ + 1 > last_decided_ + credit_) return std::nullopt;
      entry.seq = ++last_seq_;
    }
    if (entry.timer.due(now)) {
      entry.timer.sent(now);
      return Sendable{{session_, entry.seq}, entry.item};
    }
  }
  return std::nullopt;
}

template <typename Topic>
std::vector<typename Topic::Reply> CommandSpool<Topic>::apply(const typename Topic::Verdict& verdict) {
  std::vector<Reply> replies;
  if (verdict.session != session_) return replies;
  credit_ = verdict.credit;
  last_decided_ = std::max(last_decided_, std::min(verdict.last_decided, last_seq_));
  while (!entries_.empty() && entries_.front().seq != 0 && entries_.front().seq <= last_decided_) {
    const uint64_t seq = entries_.front().seq;
    const auto outcome = std::find_if(verdict.recent.begin(), verdict.recent.end(),
                                      [seq](const auto& o) { return o.seq == seq; });
    replies.push_back(outcome != verdict.recent.end() ? Topic::reply(*entries_.front().item, *outcome)
                                                      : Topic::reply(*entries_.front().item, seq, false,
                                                                     "decided; the reason was missed"));
    entries_.pop_front();
  }
  return replies;
}

template <typename Topic>
void CommandSpool<Topic>::resend_all() {
  for (Entry& entry : entries_) entry.timer.send_at_once();
}

template <typename Topic>
std::vector<typename Topic::Reply> CommandSpool<Topic>::restart(SessionId session,
                                                                const std::string& reason) {
  std::vector<Reply> replies;
  for (const Entry& entry : entries_) replies.push_back(Topic::reply(*entry.item, entry.seq, false, reason));
  *this = CommandSpool(limit_, session);
  return replies;
}

template class CommandSpool<OfferTopic>;
template class CommandSpool<RequestTopic>;

}  // namespace cairn
