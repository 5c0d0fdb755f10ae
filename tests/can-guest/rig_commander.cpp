// SPDX-License-Identifier: Apache-2.0
// `cairnctl rig` and nothing else of cairnctl, whose libraries for pictures take an emulated machine longer
// to load than a rig takes to home: rig_commander [--domain N] rig NAME ...
#include <CLI/CLI.hpp>

#include "common/base/log.h"
#include "common/wire/log_redirect.h"
#include "server/admin/interruption.h"
#include "server/admin/rig_commands.h"

int main(int argc, char** argv) {
  using namespace cairn;
  constexpr int kInterrupted = 130;
  CLI::App app("Commands a rig.", "rig_commander");
  RigClientOptions network;
  network.profile = "loopback";
  app.add_option("--domain", network.domain, "DDS domain");
  RigAction action;
  describe_rig(&app, &action);
  CLI11_PARSE(app, argc, argv);
  if (!action) return exit_code(ErrorCode::kUsage);
  const wire::LogRedirect quiet(null_logger());
  const Status done = action(network, false);
  if (done) return 0;
  say_error("rig_commander", done.error().message);
  return Interruption::requested() ? kInterrupted : exit_code(done.error().code);
}
