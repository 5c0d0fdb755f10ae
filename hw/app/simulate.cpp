// SPDX-License-Identifier: Apache-2.0
#include "hw/app/simulate.h"

#include <cstdio>
#include <functional>
#include <future>
#include <memory>
#include <string>

#include "common/base/log.h"
#include "common/base/utf8.h"
#include "hw/app/input_lines.h"
#include "hw/app/scaled_clock.h"
#ifdef CAIRN_SIMULATOR
#include "tests/world/camera_feed.h"
#endif

namespace cairn {
namespace {

constexpr std::chrono::milliseconds kStep{1};

using Teller = std::function<void(Timestamp, const SE3&)>;

/// Tells who asks at that path where the camera is.
Result<Teller> open_teller(const std::string& path) {
  if (path.empty()) return Teller([](Timestamp, const SE3&) {});
#ifdef CAIRN_SIMULATOR
  auto opened = CameraFeed::open(path);
  if (!opened) return tl::unexpected(opened.error());
  return Teller([feed = std::make_shared<CameraFeed>(*std::move(opened))](Timestamp time, const SE3& pose) {
    feed->tell({time, pose});
  });
#else
  return fail(ErrorCode::kUsage, "--camera: this program was built without the world simulator");
#endif
}

}  // namespace

Status run_simulation(const RigOptions& options, const RigConfiguration& configuration,
                      const sigset_t& signals, CanBus& bus, const HostOfDevices& host) {
  const auto tell = open_teller(options.camera);
  if (!tell) return tl::unexpected(tell.error());
  const ScaledClock clock(options.time_scale);
  SimulatedRig rig(configuration, options.faults, options.seed, clock.now(), [](const std::string& line) {
    std::printf("%s\n", line.c_str());
    std::fflush(stdout);
  });
  InputLines lines;
  std::string trouble;
  const auto go_on = [&] {
    while (const auto line = lines.next()) {
      if (Status done = rig.obey(*line, clock.now()); !done) say_error("cairn-rig", done.error().message);
    }
    const Timestamp time = clock.wall_time();
    rig.turn(bus, clock.now());
    (*tell)(time, rig.world_from_camera());
    // A pair of sockets is closed by the rig's end when that is done.
    std::string now = options.can.empty() ? "" : describe(bus.health(), options.can);
    if (now != trouble && !now.empty() && !options.can.empty()) say_error("cairn-rig", now);
    trouble = std::move(now);
  };
  const auto step = std::chrono::duration_cast<std::chrono::nanoseconds>(kStep) * options.time_scale;
  const timespec wait{step.count() / 1'000'000'000, step.count() % 1'000'000'000};
  for (int signal = 0; signal <= 0 || signal == SIGUSR1; signal = sigtimedwait(&signals, nullptr, &wait)) {
    if (signal == SIGUSR1) host.stop();
    go_on();
  }
  // The drives answer until they were let go.
  auto closed = std::async(std::launch::async, host.close);
  while (closed.wait_for(step) != std::future_status::ready) go_on();
  rig.tell_extremes();
  return {};
}

}  // namespace cairn
