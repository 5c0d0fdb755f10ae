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
  /// `pause`: the most between two things that he asks.
  SimulatedOperator(World* world, std::string name, std::chrono::milliseconds pause)
      : world_(*world),
        name_(std::move(name)),
        pause_(pause),
        session_{world->random()},
        begin_at_(world->clock->now() + std::chrono::seconds(2)) {}
  virtual ~SimulatedOperator() = default;
  SimulatedOperator(const SimulatedOperator&) = delete;
  SimulatedOperator& operator=(const SimulatedOperator&) = delete;

  void act();
  void receive(const wire::AdminReply& reply);
  [[nodiscard]] std::string waits_for() const { return asked_ ? "an answer to " + asked_->dump() : ""; }

 protected:
  /// What is asked next, of one of the maps that there are.
  [[nodiscard]] virtual nlohmann::json some_verb(MapId map) = 0;
  virtual void hear(const nlohmann::json& asked, const wire::AdminReply& reply) = 0;
  /// Asked at once.
  void ask(nlohmann::json request);

  World& world_;

 private:
  void send();

  const std::string name_;
  const std::chrono::milliseconds pause_;
  const SessionId session_;
  uint64_t last_ = 0;
  std::optional<nlohmann::json> asked_;
  MonotonicTime begin_at_;
  MonotonicTime send_at_;
};

/// Renames, deletes and undeletes maps, and changes rights.
class Housekeeper : public SimulatedOperator {
 public:
  /// `clients`: whom rights are given to and taken from.
  Housekeeper(World* world, std::string name, std::vector<std::string> clients)
      : SimulatedOperator(world, std::move(name), std::chrono::seconds(3)), clients_(std::move(clients)) {}

 private:
  [[nodiscard]] nlohmann::json some_verb(MapId map) override;
  void hear(const nlohmann::json& asked, const wire::AdminReply& reply) override;
  [[nodiscard]] nlohmann::json some_map_verb();
  [[nodiscard]] nlohmann::json some_rights_verb();

  const std::vector<std::string> clients_;
  MapId map_;  ///< that it is about
};

}  // namespace cairn::simulation
