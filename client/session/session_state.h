// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "client/session/link_monitor.h"
#include "client/session/session.h"
#include "client/session/spool.h"
#include "common/wire/messages.h"

namespace cairn {

constexpr const char* kRestartedText = "server restarted without this map";

/// A revision that must be swapped in before a lockstep client goes on.
struct RequiredRevision {
  MapId map;
  Epoch epoch;
  Revision revision;
};

/// What the frame loop, the receiver and the sender of a session share. Everything is guarded by `mutex`,
/// which is held for moments only: never while encoding, writing, taking or building snapshots.
struct SessionState {
  SessionState(SessionOptions o, ClientId id, SessionId session)
      : options(std::move(o)),
        client(id),
        session_id(session),
        spool(options.spool_limit, session),
        seed(session),
        question(session) {
    tracker.client = id;
  }

  const SessionOptions options;
  const ClientId client;

  mutable std::mutex mutex;
  std::condition_variable for_sender;   ///< something may be sent
  std::condition_variable for_waiters;  ///< link, decisions or snapshot changed
  bool stopping = false;

  SessionId session_id;
  LinkMonitor monitor;
  bool restarted = false;  ///< the server in sight is not the one that the map in use came from
  std::string refusal;     ///< why the server does not serve us; empty: it does

  Spool spool;
  SeedSlot seed;
  std::optional<SeedReply> seed_reply;
  std::vector<OfferReply> offer_replies;
  QuestionSlot question;
  std::optional<PlaceAnswer> place_answer;

  wire::TrackerStateMessage tracker;  ///< to publish, complete but for the replica
  bool tracker_changed = true;

  MapId map_in_use;
  uint64_t map_choice = 0;  ///< counts choices of a map: left and chosen again is another replica
  MapSnapshotPtr snapshot;  ///< of the map in use
  std::optional<RequiredRevision> required;

  void choose_map(MapId map) {
    if (map_in_use == map) return;
    map_in_use = map;
    ++map_choice;
    snapshot = nullptr;
    required.reset();
    restarted = false;
  }
  /// Whether `required` is swapped in.
  [[nodiscard]] bool is_current() const {
    if (!required || required->map != map_in_use) return true;
    if (snapshot == nullptr || snapshot->epoch != required->epoch)
      return snapshot && snapshot->epoch > required->epoch;
    return snapshot->revision >= required->revision;
  }
  /// Whether the server in sight knows the map in use (or there is none).
  [[nodiscard]] bool is_map_known() const { return !map_in_use || !restarted || monitor.knows(map_in_use); }
};

}  // namespace cairn
