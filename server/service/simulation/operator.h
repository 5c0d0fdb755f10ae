// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "server/service/simulation/world.h"

namespace cairn::simulation {

/// Asks one thing after the other, each until it is answered, also of the next server.
class SimulatedOperator {
 public:
  /// `clients`: whom rights are given to and taken from.
  SimulatedOperator(World* world, std::string name, std::vector<std::string> clients)
      : world_(*world),
        name_(std::move(name)),
        clients_(std::move(clients)),
        session_{world->random()},
        begin_at_(world->clock->now() + std::chrono::seconds(2)) {}

  void act();
  void receive(const wire::AdminReply& reply);
  [[nodiscard]] std::string waits_for() const { return asked_ ? "an answer to " + asked_->dump() : ""; }

 private:
  void begin_something();
  [[nodiscard]] nlohmann::json some_map_verb();
  [[nodiscard]] nlohmann::json some_rights_verb();
  void send();

  World& world_;
  const std::string name_;
  const std::vector<std::string> clients_;
  const SessionId session_;
  uint64_t last_ = 0;
  std::optional<nlohmann::json> asked_;
  MapId map_;  ///< that it is about
  MonotonicTime begin_at_;
  MonotonicTime send_at_;
};

}  // namespace cairn::simulation
