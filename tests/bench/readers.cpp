// SPDX-License-Identifier: Apache-2.0
// cairn-readers: many clients without cameras in one process, for what a server does for each: with a map
// they hold a replica of it and say 30 times a second that they track in it, as readers do; without one they
// are there and idle. At the end it prints what they have received.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "client/session/session.h"
#include "common/base/log.h"
#include "common/base/result.h"
#include "common/wire/log_redirect.h"

namespace cairn {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::seconds;

constexpr std::chrono::nanoseconds kFrame{33'333'333};

struct Wish {
  int domain = 0;
  int count = 1;
  int first = 1;     ///< number of the first of them
  int lasting = 30;  ///< seconds, from when all are served
  std::string map;   ///< its id; empty: idle
};

using Readers = std::vector<std::unique_ptr<Session>>;

Result<Readers> join(const Wish& wish, const CameraPtr& camera) {
  Readers readers;
  for (int i = 0; i < wish.count; ++i) {
    SessionOptions options;
    options.domain = wish.domain;
    options.name = "reader-" + std::to_string(wish.first + i);
    options.reads_only = true;
    auto session = Session::open(options, camera, null_logger());
    if (!session) return tl::unexpected(session.error());
    readers.push_back(std::move(*session));
  }
  for (const auto& reader : readers) {
    if (!reader->wait_for_server(seconds(60)) || !reader->wait_for_name(seconds(60)))
      return fail(ErrorCode::kNoServer, "no server answers in domain " + std::to_string(wish.domain) +
                                            "; start cairn-server there");
  }
  return readers;
}

/// What a tracker says of a frame in which it has found itself.
FrameResult tracked_in(const MapSnapshot& map) {
  FrameResult result;
  result.state = TrackingState::kTracking;
  result.pose_measured = true;
  result.map = map.map;
  result.epoch = map.epoch;
  result.revision = map.revision;
  result.quality = 1;
  return result;
}

Status hold(const Wish& wish, MapId map) {
  const auto camera = make_camera({CameraModel::kPinholeRadtan, 640, 480, {500, 500, 319.5, 239.5}});
  if (!camera) return tl::unexpected(camera.error());
  const auto readers = join(wish, *camera);
  if (!readers) return tl::unexpected(readers.error());
  if (map) {
    for (const auto& reader : *readers) reader->use_map(map);
  }
  std::fprintf(stderr, "cairn-readers: %d are there\n", wish.count);
  const Clock::time_point end = Clock::now() + seconds(wish.lasting);
  for (Clock::time_point next = Clock::now(); next < end; next += kFrame) {
    std::this_thread::sleep_until(next);
    for (const auto& reader : *readers) {
      const MapSnapshotPtr snapshot = map ? reader->snapshot() : nullptr;
      const Timestamp now{std::chrono::duration_cast<std::chrono::nanoseconds>(
                              std::chrono::system_clock::now().time_since_epoch())
                              .count()};
      if (snapshot != nullptr) reader->publish_state(tracked_in(*snapshot), now);
    }
  }
  size_t with_map = 0;
  uint64_t received = 0;
  uint64_t least_revision = UINT64_MAX;
  for (const auto& reader : *readers) {
    const MapSnapshotPtr snapshot = reader->snapshot();
    with_map += snapshot != nullptr ? 1 : 0;
    least_revision = std::min(least_revision, snapshot != nullptr ? snapshot->revision.value : 0);
    received += reader->status().bytes_received;
  }
  std::printf("%s\n", nlohmann::json{{"readers", wish.count},
                                     {"with_map", with_map},
                                     {"least_revision", least_revision},
                                     {"bytes_received", received}}
                          .dump()
                          .c_str());
  return {};
}

int run(int argc, char** argv) {
  Wish wish;
  CLI::App app("Many clients without cameras in one process: readers of a map, or idle ones.");
  app.add_option("--domain", wish.domain, "DDS domain")->capture_default_str();
  app.add_option("--count", wish.count, "how many")->check(CLI::Range(1, 200))->capture_default_str();
  app.add_option("--first", wish.first, "number of the first, where several processes share a server")
      ->check(CLI::Range(1, 100'000))
      ->capture_default_str();
  app.add_option("--seconds", wish.lasting, "for so long")->check(CLI::Range(1, 3600))->capture_default_str();
  app.add_option("--map", wish.map, "id of the map that they read; without it they are idle");
  CLI11_PARSE(app, argc, argv);
  const wire::LogRedirect quiet(null_logger());
  const auto bytes = from_hex(wish.map);
  if (!wish.map.empty() && !bytes) {
    std::fprintf(stderr, "cairn-readers: --map %s: expected the 32 digits of `cairnctl --json maps`\n",
                 wish.map.c_str());
    return exit_code(ErrorCode::kUsage);
  }
  const Status done = hold(wish, wish.map.empty() ? MapId{} : MapId{*bytes});
  if (done) return 0;
  std::fprintf(stderr, "cairn-readers: %s\n", done.error().message.c_str());
  return exit_code(done.error().code);
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  return cairn::run(argc, argv);
}
