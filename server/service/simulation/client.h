// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <map>
#include <optional>
#include <string>

#include "server/service/simulation/world.h"

namespace cairn::simulation {

/// A tracker as the server sees it: it keeps the rules of the protocol (numbers without gaps, credit, sending
/// again), and does at random what a tracker may do.
class SimulatedClient {
 public:
  SimulatedClient(World* world, std::string name);

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] bool is_connected() const { return is_connected_; }
  /// Does what is to be done by now.
  void act();
  /// Something is on its way to it.
  void receive(const Delivery& delivery);
  /// The server has gone.
  void cut_off();
  /// What it still waits for, in words; empty: nothing.
  [[nodiscard]] std::string waits_for() const;
  /// What the map shows that came of a seed of its.
  [[nodiscard]] size_t place_of(const wire::CommandId& seed) const {
    const auto place = seed_places_.find(seed);
    return place == seed_places_.end() ? 0 : place->second;
  }

 private:
  struct Replica {
    MapSnapshotPtr newest;
    std::map<LabelId, Label> labels;
  };
  template <typename Verdict, typename Command>
  static void settle(const Verdict& verdict, std::map<uint64_t, Command>* pending);

  void begin_process();
  void connect();
  void take_in_something();
  void take_in(const Delivery& delivery);
  void take_in(const ClientEvent& event);
  void send_again();
  void begin_something();
  void begin_seed();
  void begin_offer();
  void begin_query();
  void begin_request();
  /// One of those that it follows; now and then one of which it should know nothing.
  [[nodiscard]] std::optional<MapId> some_map();
  [[nodiscard]] const MapSnapshot* replica_of(MapId map) const;

  World& world_;
  const std::string name_;
  const ClientId id_;
  SessionId session_;
  wire::PeerId process_;
  wire::PublicationHandle publication_;
  bool is_connected_ = false;
  MonotonicTime connect_at_;
  MonotonicTime speak_at_;
  MonotonicTime send_at_;
  MonotonicTime begin_at_;
  std::deque<Delivery> coming_;
  std::map<MapId, wire::MapInfo> listed_;
  std::map<MapId, Replica> replicas_;

  uint64_t last_seed_ = 0;
  uint64_t last_offer_ = 0;
  uint64_t last_request_ = 0;
  uint64_t last_query_ = 0;
  std::optional<wire::MapSeed> seed_;
  std::optional<wire::RelocQuery> query_;
  std::map<uint64_t, wire::KeyframeOffer> offers_;
  std::map<uint64_t, wire::ClientRequest> requests_;
  std::map<uint64_t, std::pair<MapId, int>> steps_;  ///< of offers of this session: where they were taken
  std::map<wire::CommandId, size_t> seed_places_;
  uint64_t offers_decided_ = 0;
  uint64_t requests_decided_ = 0;
};

}  // namespace cairn::simulation
