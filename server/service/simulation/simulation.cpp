// SPDX-License-Identifier: Apache-2.0
#include "server/service/simulation/simulation.h"

#include <deque>
#include <exception>
#include <memory>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "common/io/test_directory.h"
#include "server/service/simulation/client.h"
#include "server/service/simulation/operator.h"

namespace cairn::simulation {
namespace {

constexpr std::chrono::seconds kLength{8};  ///< of what is done and goes wrong
constexpr std::chrono::seconds kCalm{60};   ///< in which all that was begun has to come to its end
constexpr double kRestarts = 0.004;         ///< at each step
constexpr double kKills = 0.006;
constexpr double kFullDisks = 0.004;

class Run {
 public:
  Run(uint64_t seed, Logger log) : world_(seed), log_(std::move(log)) {
    for (const char* name : {"anna", "ben", "cleo"}) clients_.emplace_back(&world_, name);
    operators_.push_back(
        std::make_unique<Housekeeper>(&world_, "olga", std::vector<std::string>{"anna", "ben", "cleo"}));
    auto curator = std::make_unique<Curator>(&world_, "otto", backups_.path());
    curator_ = curator.get();
    operators_.push_back(std::move(curator));
  }
  [[nodiscard]] Report report();

 private:
  void start_server();
  void stop_server(bool killed);
  void do_mischief();
  void step();
  [[nodiscard]] std::string waits_for() const;
  [[nodiscard]] bool is_well() const { return world_.history.violations().empty(); }
  void come_to_an_end();
  void check_after_the_end();
  [[nodiscard]] InProcess::Listener listener();
  void hear(const std::string& client, const Delivery& delivery);

  World world_;
  const Logger log_;
  const TestDirectory directory_;
  const TestDirectory backups_;
  std::deque<SimulatedClient> clients_;
  std::vector<std::unique_ptr<SimulatedOperator>> operators_;
  Curator* curator_ = nullptr;  ///< one of these
  std::optional<MonotonicTime> disk_is_full_until_;
  bool cut_is_due_ = false;
  Report report_;
};

InProcess::Listener Run::listener() {
  return {[this](const auto& client, const auto& delivery) { hear(client, delivery); },
          [this](const auto&, const auto& reply) {
            if (world_.disk.is_cut()) return;
            for (const auto& each : operators_) each->receive(reply);
          },
          [this](MapId map, const MapSnapshotPtr& newest) {
            if (world_.disk.is_cut()) return;
            ++report_.revisions;
            world_.history.revised(map, newest);
          }};
}

/// What a server says whose disk is cut off is said by nobody: it was killed when that happened.
void Run::hear(const std::string& name, const Delivery& delivery) {
  if (world_.disk.is_cut()) return;
  if (const auto* event = std::get_if<ClientEvent>(&delivery)) {
    const auto* seed = std::get_if<wire::SeedVerdict>(event);
    if (seed != nullptr && seed->accepted)
      for (const SimulatedClient& client : clients_)
        if (client.name() == name) world_.places.try_emplace(seed->map, client.place_of(seed->command));
  }
  world_.history.delivered(name, delivery);
  for (SimulatedClient& client : clients_) {
    if (client.name() == name) client.receive(delivery);
  }
}

void Run::start_server() {
  world_.disk.mend();
  disk_is_full_until_.reset();
  cut_is_due_ = false;
  ++report_.starts;
  world_.history.server_started();
  ServerRun::Setup setup{directory_.path(),       world_.clock, &world_.random,
                         std::chrono::seconds(4), listener(),   log_};
  setup.adjust = [](MapServiceOptions& options) {
    options.proposals.interval = std::chrono::milliseconds(0);
  };
  setup.opened = [this](const SiteAccess& site) {
    const auto policy = site.policy();
    world_.history.allow_as({[policy](const std::string& client, MapId map) {
                               return policy->in_map(client_principal(client), map).right;
                             },
                             [policy](const std::string& client) {
                               return policy->on_creating(client_principal(client)).right >= Right::kWrite;
                             }});
  };
  auto server = ServerRun::start(setup);
  if (!server) return world_.history.violated("the server does not start: " + server.error().message);
  world_.server = std::move(*server);
}

void Run::stop_server(bool killed) {
  log_->info("the server is {}", killed ? "killed" : "ended");
  if (killed) {
    ++report_.kills;
    world_.disk.cut();
    world_.server->kill();
  } else {
    world_.server->end();
  }
  world_.server.reset();
  world_.disk.mend();
  for (SimulatedClient& client : clients_) client.cut_off();
  world_.history.check_store(directory_.path());
  curator_->check_backups();
}

void Run::do_mischief() {
  if (world_.disk.is_cut()) return stop_server(true);
  if (world_.chance(kRestarts)) return stop_server(false);
  if (world_.chance(kKills)) {
    if (world_.chance(0.3)) return stop_server(true);
    if (!std::exchange(cut_is_due_, true)) world_.disk.cut_after(1 + world_.draw(60));
  }
  const MonotonicTime now = world_.clock->now();
  if (disk_is_full_until_ && now >= *disk_is_full_until_) {
    world_.disk.set_full(false);
    disk_is_full_until_.reset();
  } else if (!disk_is_full_until_ && world_.chance(kFullDisks)) {
    world_.disk.set_full(true);
    disk_is_full_until_ = now + world_.between(100, 5000);
  }
}

void Run::step() {
  world_.clock->advance(world_.is_calm ? std::chrono::milliseconds(50) : world_.between(0, 60));
  if (world_.server == nullptr) start_server();
  if (world_.server == nullptr) return;
  world_.deliver();
  for (SimulatedClient& client : clients_) client.act();
  for (const auto& each : operators_) each->act();
  world_.server->tick_if_due();
  size_t tasks = world_.is_calm ? 500 : world_.draw(12);
  while (tasks > 0 && !world_.disk.is_cut() && world_.server->run_something()) --tasks;
  if (!world_.is_calm) do_mischief();
}

std::string Run::waits_for() const {
  for (const SimulatedClient& client : clients_) {
    if (std::string what = client.waits_for(); !what.empty()) return client.name() + " waits for " + what;
  }
  for (const auto& each : operators_) {
    if (std::string what = each->waits_for(); !what.empty()) return "an operator waits for " + what;
  }
  return {};
}

/// Runs in a calm world until all that was begun is decided; that it is not within kCalm is a violation.
void Run::come_to_an_end() {
  world_.is_calm = true;
  if (world_.server != nullptr && world_.disk.is_cut()) stop_server(true);
  world_.disk.mend();
  const MonotonicTime end = world_.clock->now() + kCalm;
  const MonotonicTime least = world_.clock->now() + std::chrono::seconds(5);
  while (is_well() && world_.clock->now() < end && (world_.clock->now() < least || !waits_for().empty()))
    step();
  if (std::string what = waits_for(); !what.empty())
    world_.history.violated("all is calm, and still " + what);
}

void Run::check_after_the_end() {
  std::set<std::string> names;
  for (const SimulatedClient& client : clients_) names.insert(client.name());
  world_.history.check_listed(names);
  stop_server(false);
  if (!is_well()) return;
  // The next server has the same.
  const MonotonicTime end = world_.clock->now() + std::chrono::seconds(5);
  while (is_well() && world_.clock->now() < end) step();
  world_.history.check_listed(names);
}

Report Run::report() {
  try {
    const MonotonicTime end = world_.clock->now() + kLength;
    while (is_well() && world_.clock->now() < end) step();
    if (is_well()) come_to_an_end();
    if (is_well()) check_after_the_end();
  } catch (const std::exception& problem) {
    world_.history.violated(std::string("a task threw: ") + problem.what());
  }
  if (world_.server != nullptr) world_.disk.cut();
  world_.server.reset();
  report_.maps = world_.history.maps().size();
  report_.curated = curator_->done();
  report_.violations = world_.history.violations();
  return report_;
}

}  // namespace

Report run(uint64_t seed, const Logger& log) {
  return Run(seed, log).report();
}

}  // namespace cairn::simulation
