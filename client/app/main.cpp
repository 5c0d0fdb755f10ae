// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <array>
#include <cstdio>
#include <exception>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "client/app/application.h"
#include "client/app/calibrate/calibrate.h"
#include "client/app/stop_signal.h"
#include "client/app/track_options.h"
#include "common/base/log.h"
#include "common/base/utf8.h"

namespace {

/// Prints help or a complaint, and returns the exit code. Call it before a StopSignal holds signals back, so
/// that somebody who reads our help and hangs can interrupt it.
int leave(const cairn::ParseExit& exit) {
  std::fputs(cairn::many_lines(exit.text).c_str(), exit.code == 0 ? stdout : stderr);
  return exit.code;
}

int calibrate(std::vector<std::string> arguments) {
  const auto parsed = cairn::parse_calibrate_options(std::move(arguments));
  if (const auto* exit = std::get_if<cairn::ParseExit>(&parsed)) return leave(*exit);
  cairn::StopSignal stop;  // before any thread
  const auto& options = std::get<cairn::CalibrateOptions>(parsed);
  const auto log = cairn::make_logger("cairn-track", options.verbosity);
  return cairn::run_calibrate(options, log, [&stop] { return stop.requested(); });
}

int track(const std::vector<std::string>& arguments) {
  std::array<char, 256> host{};
  if (gethostname(host.data(), host.size() - 1) != 0) host[0] = '\0';
  auto parsed = cairn::parse_track_options(arguments, host.data(), getpid());
  if (const auto* exit = std::get_if<cairn::ParseExit>(&parsed)) return leave(*exit);
  cairn::StopSignal stop;  // before any thread
  const auto& options = std::get<cairn::TrackOptions>(parsed);
  const auto log = cairn::make_logger("cairn-track", options.verbosity);
  return cairn::run_tracker(
      options, log, {[&stop] { return stop.requested(); }, [&stop] { return stop.new_map_requested(); }});
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const std::vector<std::string> arguments(argv + 1, argv + argc);
    if (!arguments.empty() && arguments.front() == "calibrate")
      return calibrate({arguments.begin() + 1, arguments.end()});
    return track(arguments);
  } catch (const std::exception& error) {
    cairn::say_error("cairn-track", std::string("internal error: ") + error.what());
    return 1;
  }
}
