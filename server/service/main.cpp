// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <exception>
#include <fstream>
#include <string>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include "common/base/log.h"
#include "common/wire/log_redirect.h"
#include "common/wire/participant.h"
#include "server/service/server_options.h"
#include "server/service/service.h"
#include "server/service/wearer_list.h"

namespace {

/// SIGINT, SIGTERM and SIGHUP, blocked here and in every thread begun later. There are no settings to be read
/// again: SIGHUP means that the terminal has gone, unless nohup has it ignored (what is blocked is not).
sigset_t block_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  struct sigaction hangup {};
  sigaction(SIGHUP, nullptr, &hangup);
  if (hangup.sa_handler != SIG_IGN) sigaddset(&signals, SIGHUP);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  return signals;
}

int complain(const cairn::Error& error) {
  std::fprintf(stderr, "cairn-server: %s\n", error.message.c_str());
  return cairn::exit_code(error.code);
}

int serve(const cairn::ServerOptions& options, const sigset_t& signals) {
  const auto log = cairn::make_logger("cairn-server", options.verbosity);
  // A file-size limit is a full disk like any other, and a log that nobody reads any more is no reason to go:
  // errors of the write, not the end.
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);
  const cairn::wire::LogRedirect middleware_log(log);
  cairn::ServiceOptions service;
  service.domain = options.domain;
  service.listen = options.listen;
  service.profile = options.profile;
  service.seed = options.seed;
  service.mapping.adjuster = options.adjuster;
  service.relocalization.method = options.relocalizer;
  service.max_maps = options.max_maps;
  service.max_memory_bytes = options.max_memory_mb * 1'000'000;
  service.store = options.store;
  service.rest_after = options.rest_after;
  service.wearers.policy = options.wearer_policy;
  if (!options.wearers.empty()) {
    auto registered = cairn::read_wearers(options.wearers);
    if (!registered) return complain(registered.error());
    service.wearers.registered = std::move(*registered);
  }
  service.workers = static_cast<int>(std::max(2U, std::thread::hardware_concurrency()));
  cairn::name_this_start(&service);
  if (options.store.empty()) {
    std::fprintf(stderr,
                 "cairn-server: maps are kept in memory only and end with it; --store DIR keeps them\n");
  }
  std::ofstream stats;
  if (!options.stats.empty()) {
    stats.open(options.stats, std::ios::trunc);
    if (!stats) return complain({cairn::ErrorCode::kIo, options.stats + ": cannot be written"});
  }
  cairn::WorkTimes work_times;
  service.work_times = &work_times;
  auto running = cairn::Service::start(service, log);
  if (!running) return complain(running.error());
  std::fprintf(stderr, "cairn-server: ready on domain %d, UDP port %d, profile %s\n", options.domain,
               int{cairn::wire::server_port(static_cast<uint32_t>(options.domain))}, options.profile.c_str());
  int signal = 0;
  sigwait(&signals, &signal);
  log->info("stopping");
  running->reset();
  if (!stats.is_open()) return 0;
  stats << work_times.to_json();
  stats.close();
  return stats ? 0 : complain({cairn::ErrorCode::kIo, options.stats + ": cannot be written"});
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const sigset_t signals = block_signals();  // before any thread
    const auto parsed = cairn::parse_server_options({argv + 1, argv + argc});
    if (const auto* exit = std::get_if<cairn::EarlyExit>(&parsed)) {
      std::fputs(exit->text.c_str(), exit->code == 0 ? stdout : stderr);
      return exit->code;
    }
    return serve(std::get<cairn::ServerOptions>(parsed), signals);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "cairn-server: internal error: %s\n", error.what());
    return 1;
  }
}
