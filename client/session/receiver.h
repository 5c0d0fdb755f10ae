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
#include "client/session/map_directory.h"
#include "client/session/replica.h"
#include "client/session/session_state.h"
#include "common/base/log.h"
#include "common/base/rate_limit.h"
#include "common/wire/participant.h"
#include "common/wire/topic.h"
#include "common/wire/waiter.h"

namespace cairn {

/// What a receiver has made of what came, for the next one when a session joins anew.
struct ReceiverMemory {
  struct MapCopy {
    explicit MapCopy(MapId map) : replica(map) {}
    Replica replica;
    bool snapshot_due = false;  ///< it waits for the values of our camera that it was made with
    LabelReplica labels;
  };
  MapDirectory directory;
  std::map<MapId, MapCopy> maps;  ///< that were in use of late
};

/// A session's incoming half, with its own thread: what the server says, and the replicas of the maps
/// in use of late.
class Receiver {
 public:
  /// `memory` outlives it.
  [[nodiscard]] static Result<std::unique_ptr<Receiver>> start(SessionState& state, ReceiverMemory& memory,
                                                               const wire::Participant& participant,
                                                               const std::string& client_name, Logger log);
  /// Set state.stopping before.
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

  Receiver(SessionState& state, ReceiverMemory& memory, wire::Participant participant,
           std::string client_name, ServerReaders readers, wire::Waiter waiter, Logger log);

  void run();
  [[nodiscard]] std::chrono::milliseconds time_to_wait() const;
  void follow_recent_maps();
  [[nodiscard]] Result<MapChannel> open_channel(MapId map);
  void take_server_messages();
  void take_map_messages(MapChannel& channel, ReceiverMemory::MapCopy& copy);
  void take_labels(MapChannel& channel, ReceiverMemory::MapCopy& copy);
  void act_on(const wire::ClientReply& reply);
  void act_on(LinkMonitor::Event event);
  void act_on(const wire::SeedVerdict& verdict);
  void act_on(const wire::OfferVerdict& verdict);
  void act_on(wire::RelocAnswer&& answer);
  void act_on(const wire::CameraEstimate& estimate);
  /// `key`: of an estimate that is no more.
  void forget_camera(const wire::CameraEstimate& key);
  /// In the first revision of a map made from our seed.
  void check_that_camera_is_found_out(const MapSnapshot& first);

  SessionState& state_;
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

/// Never 0, different for every run and process.
[[nodiscard]] SessionId random_session();

}  // namespace cairn
