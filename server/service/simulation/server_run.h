// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>

#include "server/service/map_service.h"
#include "server/service/simulation/in_process.h"
#include "server/service/simulation/simulated_executors.h"
#include "server/service/site_access.h"

namespace cairn::simulation {

/// A server from one start to its end, in one thread: what would run next is chosen by chance.
class ServerRun {
 public:
  struct Setup {
    std::filesystem::path folder;
    std::shared_ptr<const FakeClock> clock;
    Random* random = nullptr;
    std::chrono::seconds idle_after{4};
    InProcess::Listener listener;
    Logger log;
    std::function<void(const SiteAccess& site)> opened = {};  ///< before anything is said
    std::function<void(MapServiceOptions& options)> adjust = {};
  };
  [[nodiscard]] static Result<std::unique_ptr<ServerRun>> start(const Setup& setup);
  ~ServerRun();
  ServerRun(const ServerRun&) = delete;
  ServerRun& operator=(const ServerRun&) = delete;

  [[nodiscard]] MapService& service() { return *service_; }
  [[nodiscard]] InProcess& peers() { return in_process_; }
  [[nodiscard]] const SiteAccess& site() const { return *site_; }

  /// Runs one of the tasks that are due, of whichever thread. False: none is.
  bool run_something();
  /// What runs beside the writer takes long from now on: it does not come to its end while this is so.
  void let_store_strand_take_long(bool long_) { store_strand_takes_long_ = long_; }
  void tick_if_due();
  /// Ends the server, as Service::close() does.
  void end();
  /// Ends the server as if its process were killed: nothing that waits is done.
  void kill();

 private:
  explicit ServerRun(const Setup& setup);
  [[nodiscard]] Status open(const Setup& setup);
  void drop_all();

  const std::shared_ptr<const FakeClock> clock_;
  Random& random_;
  SimulatedExecutor home_{1};
  SimulatedExecutor urgent_{2};
  SimulatedExecutor background_{1};
  SimulatedExecutor queries_{2};
  SimulatedExecutor idle_{1};
  SimulatedExecutor site_changes_{1};
  InProcess in_process_;
  std::unique_ptr<SiteAccess> site_;
  WriterTurns* writer_ = nullptr;              ///< of store_
  SimulatedExecutor* store_strand_ = nullptr;  ///< likewise
  SimulatedExecutor* examiner_ = nullptr;      ///< likewise
  bool store_strand_takes_long_ = false;
  std::unique_ptr<MapPersistence> store_;
  std::unique_ptr<MapService> service_;
};

}  // namespace cairn::simulation
