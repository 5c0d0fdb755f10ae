// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "client/session/label_replica.h"
#include "client/session/replica.h"
#include "client/session/shared_core.h"
#include "common/base/log.h"
#include "common/base/rate_limit.h"
#include "common/wire/participant.h"
#include "common/wire/topic.h"
#include "common/wire/waiter.h"

namespace cairn {

/// The copies of maps that a receiver has made, kept for the next one when a session joins anew.
struct ReceiverMemory {
  struct MapCopy {
    explicit MapCopy(MapId map) : replica(map) {}
    Replica replica;
    bool snapshot_due = false;  ///< it waits for the values of our camera that it was made with
    LabelReplica labels;
  };
  std::map<MapId, MapCopy> maps;  ///< that were in use of late
};

/// A session's incoming half, with its own thread: what the server says, and the replicas of the maps
/// in use of late.
class Receiver {
 public:
  /// `memory` outlives it.
  [[nodiscard]] static Result<std::unique_ptr<Receiver>> start(SharedCore& core, ReceiverMemory& memory,
                                                               const wire::Participant& participant,
                                                               const std::string& client_name, Logger log);
  /// Stop the core before.
  ~Receiver();
  Receiver(const Receiver&) = delete;
  Receiver& operator=(const Receiver&) = delete;

  /// The map in use is another one. Thread-safe.
  void map_changed() { waiter_.wake(); }

 private:
  struct ServerReaders {
    wire::Reader<wire::ServerStatus> status;
    wire::Reader<wire::MapInfo> maps;
    wire::Reader<wire::SeedVerdict> seeds;
    wire::Reader<wire::OfferVerdict> offers;
    wire::Reader<wire::RelocAnswer> places;
    wire::Reader<wire::CameraEstimate> cameras;
    wire::Reader<wire::ClientReply> replies;
  };
  /// The topics of one map.
  struct MapChannel {
    wire::Reader<wire::PointPatches> patches;
    wire::Reader<wire::PointPositions> positions;
    wire::Reader<wire::KeyframePoses> keyframes;
    wire::Reader<wire::MapCommit> commits;
    wire::Reader<wire::LabelMessage> labels;
  };

  Receiver(SharedCore& core, ReceiverMemory& memory, wire::Participant participant, std::string client_name,
           ServerReaders readers, wire::Waiter waiter, Logger log);

  void run();
  [[nodiscard]] std::chrono::milliseconds time_to_wait() const;
  void follow_recent_maps();
  [[nodiscard]] Result<MapChannel> open_channel(MapId map);
  void take_server_messages();
  void take_map_messages(MapChannel& channel, ReceiverMemory::MapCopy& copy);
  void take_labels(MapChannel& channel, ReceiverMemory::MapCopy& copy);
  /// Hands what came on one of the server's topics to the core, as its events.
  template <typename Message>
  void pass_on(wire::Reader<Message>& reader);

  SharedCore& core_;
  ReceiverMemory& memory_;
  wire::Participant participant_;
  std::string client_name_;
  ServerReaders server_;
  std::map<MapId, MapChannel> channels_;  ///< of the maps of memory_
  wire::Waiter waiter_;
  RateLimit warning_;
  Logger log_;
  std::thread thread_;
};

}  // namespace cairn
