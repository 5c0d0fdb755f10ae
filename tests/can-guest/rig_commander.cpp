// SPDX-License-Identifier: Apache-2.0
// `cairnctl rig` and nothing else of cairnctl, whose libraries for images take an emulated machine longer
// to load than a rig takes to home: rig_commander [--domain N] rig NAME ...
// rig_commander [--domain N] --stop-on-word NAME joins, and stops that rig when a line comes on stdin: what
// an order takes, without what a program takes to begin.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <iostream>
#include <string>

#include "common/base/log.h"
#include "common/wire/log_redirect.h"
#include "server/admin/interruption.h"
#include "server/admin/rig_client.h"
#include "server/admin/rig_commands.h"

namespace cairn {
namespace {

Status stop_on_word(RigClientOptions network, const std::string& rig) {
  network.rig = rig;
  auto client = RigClient::join(network);
  if (!client) return tl::unexpected(client.error());
  if (const auto heard = client->state(); !heard) return tl::unexpected(heard.error());
  std::puts("ready");
  std::fflush(stdout);
  std::string word;
  std::getline(std::cin, word);
  wire::RigCommand stop;
  stop.mode = wire::RigMode::kStop;
  if (const auto stopped = client->give(stop); !stopped) return tl::unexpected(stopped.error());
  std::puts("stopped");
  return {};
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  using namespace cairn;
  constexpr int kInterrupted = 130;
  CLI::App app("Commands a rig.", "rig_commander");
  RigClientOptions network;
  network.profile = "loopback";
  app.add_option("--domain", network.domain, "DDS domain");
  RigAction action;
  describe_rig(&app, &action);
  std::string stopped_on_word;
  app.add_option("--stop-on-word", stopped_on_word, "rig");
  CLI11_PARSE(app, argc, argv);
  if (!action && stopped_on_word.empty()) return exit_code(ErrorCode::kUsage);
  const wire::LogRedirect quiet(null_logger());
  const Status done = action ? action(network, false) : stop_on_word(network, stopped_on_word);
  if (done) return 0;
  say_error("rig_commander", done.error().message);
  return Interruption::requested() ? kInterrupted : exit_code(done.error().code);
}
