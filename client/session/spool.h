// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/session/replica.h"
#include "client/session/session_types.h"
#include "common/wire/messages.h"

namespace cairn {

/// A command without a decision is sent again after this time, then after twice as long, and so on: it covers
/// what a volatile topic loses while two participants find each other. The server knows repetitions by
/// (session, seq).
constexpr std::chrono::milliseconds kFirstResend{1000};
constexpr std::chrono::milliseconds kLongestResend{16000};

/// When to send one command (again).
class ResendTimer {
 public:
  [[nodiscard]] bool due(MonotonicTime now) const { return now >= next_; }
  void sent(MonotonicTime now);
  void send_at_once();

 private:
  MonotonicTime next_ = MonotonicTime::min();
  std::chrono::milliseconds wait_ = kFirstResend;
};

/// A frame offered as keyframe, as it waits for the server.
struct SpooledOffer {
  KeyframeProposal proposal;
  GrayImagePtr image;
  Timestamp time;
};

/// Keyframe offers in a CommandSpool.
struct OfferTopic {
  using Item = SpooledOffer;
  using Verdict = wire::OfferVerdict;
  using Reply = OfferReply;
  [[nodiscard]] static Reply reply(const Item& item, uint64_t seq, bool done, std::string reason);
  [[nodiscard]] static Reply reply(const Item& item, const wire::OfferOutcome& outcome);
};
/// The topic of people's requests, for a CommandSpool.
struct RequestTopic {
  using Item = wire::ClientRequest;  ///< but for client and command
  using Verdict = wire::ClientReply;
  using Reply = RequestReply;
  [[nodiscard]] static Reply reply(const Item& item, uint64_t seq, bool done, std::string reason);
  [[nodiscard]] static Reply reply(const Item& item, const wire::RequestOutcome& outcome);
};

/// Commands of a topic from the moment they are made until the server has decided: bounded, in order, each
/// with a sequence number from the first sending on (1, 2, ... within a session). At most `credit` are in
/// flight. Pure: the time is handed in. One thread.
template <typename Topic>
class CommandSpool {
 public:
  using Item = typename Topic::Item;
  using Reply = typename Topic::Reply;

  CommandSpool(size_t limit, SessionId session) : limit_(limit), session_(session) {}

  /// Takes a command. When full, the oldest that was not sent yet goes (or, if all were, this one); the loss
  /// is reported.
  [[nodiscard]] std::optional<Reply> push(Item item);

  struct Sendable {
    wire::CommandId command;
    std::shared_ptr<const Item> item;
  };
  /// The next command that is due and within the credit, marked as sent now; nothing if there is none.
  [[nodiscard]] std::optional<Sendable> next(MonotonicTime now);

  /// Takes in the server's word: what is newly decided leaves the spool and is reported. Verdicts on other
  /// sessions are passed over; a decision that has left the list of recent ones is reported without its
  /// reason.
  [[nodiscard]] std::vector<Reply> apply(const typename Topic::Verdict& verdict);

  /// The link was interrupted: everything undecided is due again.
  void resend_all();

  /// The server is another one and knows none of the maps: every command is reported lost for `reason`,
  /// counting begins anew.
  [[nodiscard]] std::vector<Reply> restart(SessionId session, const std::string& reason);

  [[nodiscard]] size_t size() const { return entries_.size(); }
  [[nodiscard]] SessionId session() const { return session_; }

 private:
  struct Entry {
    uint64_t seq = 0;  ///< 0: never sent
    std::shared_ptr<const Item> item;
    ResendTimer timer;
  };

  size_t limit_;
  SessionId session_;
  std::deque<Entry> entries_;
  uint64_t last_seq_ = 0;
  uint64_t last_decided_ = 0;
  uint32_t credit_ = 1;  ///< until the server has said more
};

using Spool = CommandSpool<OfferTopic>;
using RequestSpool = CommandSpool<RequestTopic>;

/// The one command of a kind that may be under way: to do it twice changes nothing. Pure: the time is handed
/// in. One thread.
template <typename Item>
class CommandSlot {
 public:
  explicit CommandSlot(SessionId session) : session_(session) {}

  /// Takes a command; one that is still undecided is superseded.
  void put(Item item) {
    item_ = std::make_shared<const Item>(std::move(item));
    ++seq_;
    timer_.send_at_once();
  }

  struct Sendable {
    wire::CommandId command;
    std::shared_ptr<const Item> item;
  };
  /// The command if it is due, marked as sent now.
  [[nodiscard]] std::optional<Sendable> next(MonotonicTime now) {
    if (item_ == nullptr || !timer_.due(now)) return std::nullopt;
    timer_.sent(now);
    return Sendable{{session_, seq_}, item_};
  }

  /// Takes a decision (a verdict, an answer). Whether it is on the command under way, which it then ends.
  template <typename Decision>
  [[nodiscard]] bool apply(const Decision& decision) {
    if (item_ == nullptr || decision.command != wire::CommandId{session_, seq_}) return false;
    item_.reset();
    return true;
  }

  void resend() { timer_.send_at_once(); }
  /// Another server: what is under way is sent to it under the new session.
  void restart(SessionId session) {
    session_ = session;
    seq_ = item_ == nullptr ? 0 : 1;
    timer_.send_at_once();
  }
  /// Nobody wants to know any more, or nobody will answer: a decision is on no command.
  void drop() { item_.reset(); }
  [[nodiscard]] bool empty() const { return item_ == nullptr; }

 private:
  SessionId session_;
  uint64_t seq_ = 0;
  std::shared_ptr<const Item> item_;
  ResendTimer timer_;
};

/// The tracker makes another only after a verdict.
using SeedSlot = CommandSlot<SeedProposal>;

/// A frame described, and when it was taken.
struct SentRelocQuery {
  std::shared_ptr<const PlaceView> view;
  MapId map_hint;
  Timestamp time;
};

using QuerySlot = CommandSlot<SentRelocQuery>;

}  // namespace cairn
