// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "server/service/simulation/faulty_disk.h"
#include "server/service/simulation/history.h"
#include "server/service/simulation/server_run.h"
#include "server/service/simulation/simulated_executors.h"

namespace cairn::simulation {

/// What clients and operators share: the time, chance, the network to the server, and the history.
struct World {
  explicit World(uint64_t seed) : random(seed) {}

  Random random;
  std::shared_ptr<FakeClock> clock = std::make_shared<FakeClock>();
  FaultyDisk disk;
  History history;
  std::unique_ptr<ServerRun> server;  ///< null: none runs
  bool is_calm = false;  ///< nothing is lost, repeated or broken any more, and nobody begins anything
  std::map<MapId, size_t> places;  ///< what each map shows: Views::of_place()

  [[nodiscard]] size_t draw(size_t n) { return simulation::draw(random, n); }
  [[nodiscard]] bool chance(double probability) { return simulation::chance(random, probability); }
  [[nodiscard]] std::chrono::milliseconds between(int least, int most) {
    return std::chrono::milliseconds(least + static_cast<int>(draw(static_cast<size_t>(most - least + 1))));
  }
  /// Times of images, no two alike.
  [[nodiscard]] Timestamp next_image() { return {++images_}; }

  using Message = std::function<void(ServerRun& server)>;
  /// Sends a message to the server, if one runs when it arrives. It may be lost, repeated, late and overtaken
  /// by others, unless the world is calm. `sender`: see forget().
  void send(const std::string& sender, const Message& message) {
    if (is_calm) return post(sender, message, std::chrono::milliseconds(1));
    if (chance(0.1)) return;
    post(sender, message, delay());
    if (chance(0.1)) post(sender, message, delay());
  }
  /// The process that sent them has gone for so long that nothing of it is under way.
  void forget(const std::string& sender) {
    std::erase_if(network_, [&](const Posted& posted) { return posted.sender == sender; });
  }
  void deliver() {
    for (size_t i = 0; i < network_.size();) {
      if (network_[i].due > clock->now()) {
        ++i;
        continue;
      }
      const Message message = std::move(network_[i].message);
      network_.erase(network_.begin() + static_cast<std::ptrdiff_t>(i));
      if (server != nullptr) message(*server);
    }
  }

 private:
  struct Posted {
    std::string sender;
    MonotonicTime due;
    Message message;
  };
  [[nodiscard]] std::chrono::milliseconds delay() {
    return chance(0.1) ? between(200, 2500) : between(0, 60);
  }
  void post(const std::string& sender, const Message& message, std::chrono::milliseconds delay) {
    network_.push_back({sender, clock->now() + delay, message});
  }

  std::vector<Posted> network_;
  int64_t images_ = 0;
};

}  // namespace cairn::simulation
