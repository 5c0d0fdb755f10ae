// SPDX-License-Identifier: Apache-2.0
#include <sys/stat.h>

#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <exception>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include "common/base/ending_signals.h"
#include "common/base/exit_deadline.h"
#include "common/base/log.h"
#include "common/base/stream_writer.h"
#include "common/base/utf8.h"
#include "common/wire/log_redirect.h"
#include "common/wire/participant.h"
#include "server/endpoint/server_options.h"
#include "server/endpoint/service.h"
#include "server/endpoint/serving.h"
#include "server/service/wearer_list.h"
#include "server/service/work_times_json.h"

namespace {

/// A line on stderr. Whoever reads it is waited for 1 s at most: no signal is heard meanwhile.
void say(const std::string& text) {
  const auto words = cairn::StreamWriter::of_descriptor(STDERR_FILENO, "standard error");
  (void)words->write("cairn-server: " + cairn::one_line(text) + "\n");
  (void)words->finish({std::chrono::milliseconds(1'000), std::chrono::milliseconds(1'000)});
}

int complain(const cairn::Error& error) {
  say(error.message);
  return cairn::exit_code(error.code);
}

int serve(const cairn::ServerOptions& options, std::optional<cairn::WearerList> wearers,
          const sigset_t& signals) {
  const auto log = cairn::make_logger("cairn-server", options.verbosity);
  // A file-size limit is a full disk like any other, and a log that nobody reads any more is no reason to go:
  // errors of the write, not the end.
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);
  cairn::ServiceOptions service;
  service.refused = std::make_shared<cairn::wire::RefusedPeers>();
  constexpr int kLinesASecond = 10;
  const cairn::wire::LogRedirect middleware_log(log, kLinesASecond, service.refused);
  service.domain = options.domain;
  service.listen = options.listen;
  service.profile = options.profile;
  service.security = options.security;
  service.seed = options.seed;
  service.mapping = options.mapping;
  service.relocalization = options.relocalization;
  service.max_maps = options.max_maps;
  service.max_maps_per_client = options.max_maps_per_client;
  service.max_memory_bytes = options.max_memory_mb * 1'000'000;
  service.max_keyframes = options.max_keyframes;
  service.max_labels = options.max_labels;
  service.rates = options.rates;
  service.store = options.store;
  service.idle_after = options.idle_after;
  service.drop_after = options.drop_after;
  service.keep_deleted = options.keep_deleted;
  service.lockstep = options.lockstep;
  service.wearers.policy = options.wearer_policy;
  service.wearers.registered = std::move(wearers);
  service.workers = static_cast<int>(std::max(2U, std::thread::hardware_concurrency()));
  cairn::name_this_start(&service);
  if (options.store.empty()) {
    say("maps are kept in memory only and end with it; --store DIR keeps them");
  }
  cairn::WorkTimes work_times;
  service.work_times = &work_times;
  auto running = cairn::Service::start(service, log);
  if (!running) return complain(running.error());
  std::unique_ptr<cairn::StreamWriter> stats;  // a server that is refused leaves the figures of another alone
  if (!options.stats.empty()) {
    auto opened = cairn::StreamWriter::open(options.stats);
    if (!opened) return complain(opened.error());
    stats = std::move(*opened);
  }
  say(fmt::format("ready on domain {}, UDP port {}, profile {}, {}", options.domain,
                  cairn::wire::server_port(static_cast<uint32_t>(options.domain)), options.profile,
                  describe((*running)->network())));
  const cairn::Status served = cairn::serve_until(signals, service, &*running, log);
  log->info("stopping");
  if (*running) (*running)->close();
  int code = served ? 0 : complain(served.error());
  if (stats) {
    (void)stats->write(to_json(work_times.summaries()));  // finish() says what is missing
    if (const auto complete = stats->finish(); !complete) code = complain(complete.error());
  }
  const cairn::ExitDeadline deadline(code, cairn::kClosingPatience, log);
  running->reset();
  return code;
}

}  // namespace

int main(int argc, char** argv) {
  ::umask(0027);  // what is kept are images and rights, and no business of other users of this machine
  try {
    const auto parsed = cairn::parse_server_options({argv + 1, argv + argc});
    if (const auto* exit = std::get_if<cairn::EarlyExit>(&parsed)) {
      std::fputs(cairn::many_lines(exit->text).c_str(), exit->code == 0 ? stdout : stderr);
      return exit->code;
    }
    const auto& options = std::get<cairn::ServerOptions>(parsed);
    std::optional<cairn::WearerList> wearers;
    if (!options.wearers.empty()) {  // may be a pipe, whose writer is not waited for in spite of signals
      auto registered = cairn::read_wearers(options.wearers);
      if (!registered) return complain(registered.error());
      wearers = std::move(*registered);
    }
    // There are no settings to be read again: SIGHUP means that the terminal has gone.
    const sigset_t signals = cairn::block_ending_signals();  // before any thread
    return serve(options, std::move(wearers), signals);
  } catch (const std::exception& error) {
    cairn::say_error("cairn-server", std::string("internal error: ") + error.what());
    return 1;
  }
}
