// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <map>
#include <optional>
#include <set>
#include <string>

#include "common/base/log.h"
#include "common/base/rate_limit.h"
#include "common/base/time.h"
#include "common/wire/participant.h"
#include "common/wire/peers.h"
#include "common/wire/topic.h"
#include "server/endpoint/map_feed.h"
#include "server/service/service_output.h"

namespace cairn {

/// The server's writers in the partition of one client.
struct ClientWriters {
  wire::Writer<wire::ServerStatus> status;
  wire::Writer<wire::MapInfo> maps;
  wire::Writer<wire::SeedVerdict> seeds;
  wire::Writer<wire::OfferVerdict> offers;
  wire::Writer<wire::RelocAnswer> places;
  wire::Writer<wire::CameraEstimate> cameras;
  wire::Writer<wire::ClientReply> replies;

  [[nodiscard]] static Result<ClientWriters> create(const wire::Participant& participant,
                                                    const std::string& client);
};

/// Writes an event to its topic.
[[nodiscard]] Status write(ClientWriters& writers, const ClientEvent& event);

/// A writer to the partition of a client that is turned away, so that its tracker can tell the person why it
/// is not served.
struct Farewell {
  wire::Writer<wire::OfferVerdict> to;
  SessionId told;                            ///< the process that was told last
  RateLimit again{std::chrono::seconds(1)};  ///< where several try by turns
};

/// All that leads to one client, made when its readers are discovered.
struct ClientLink {
  int status_readers = 0;                       ///< discovered; 0: not connected
  std::optional<wire::PeerId> process;          ///< whose readers were discovered last
  std::optional<ClientWriters> writers;         ///< while connected
  std::optional<Farewell> farewell;             ///< while it is turned away and tries to be served
  std::map<MapId, int> wanted;                  ///< map readers discovered, by map
  std::map<MapId, MapFeed> feeds;               ///< of the wanted maps that there are for it
  std::set<MapId> authored;                     ///< maps that have keyframes of its
  std::optional<MonotonicTime> feed_failed_at;  ///< one more could not be made, or was one too many
};

/// Notes from a verdict in which maps a client has keyframes: of these it is sent revisions before those who
/// only read them (FeedTurns).
void note_author(const ClientEvent& verdict, ClientLink* link);

}  // namespace cairn
