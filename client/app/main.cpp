// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <array>
#include <cstdio>
#include <exception>
#include <string>
#include <variant>
#include <vector>

#include "client/app/application.h"
#include "client/app/stop_signal.h"
#include "client/app/track_options.h"
#include "common/base/log.h"

int main(int argc, char** argv) {
  try {
    cairn::StopSignal stop;  // before any thread
    std::array<char, 256> host{};
    if (gethostname(host.data(), host.size() - 1) != 0) host[0] = '\0';
    auto parsed = cairn::parse_track_options({argv + 1, argv + argc}, host.data(), getpid());
    if (const auto* exit = std::get_if<cairn::ParseExit>(&parsed)) {
      std::fputs(exit->text.c_str(), exit->code == 0 ? stdout : stderr);
      return exit->code;
    }
    const auto& options = std::get<cairn::TrackOptions>(parsed);
    const auto log = cairn::make_logger("cairn-track", options.verbosity);
    return cairn::run_tracker(
        options, log, {[&stop] { return stop.requested(); }, [&stop] { return stop.new_map_requested(); }});
  } catch (const std::exception& error) {
    std::fprintf(stderr, "cairn-track: internal error: %s\n", error.what());
    return 1;
  }
}
