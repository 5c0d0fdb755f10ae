// SPDX-License-Identifier: Apache-2.0
// cairn-rig-bench: what a rig costs at a thousand frames a second, and how long after a sample of the gyro
// the setpoint goes out that is made from it. A socket pair stands for the bus, simulated devices for the
// drives and the IMU.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "hw/can/socket_bus.h"
#include "hw/rig/rig.h"
#include "hw/simulated/simulated_bus.h"

namespace cairn {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

double cpu_seconds() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// When the newest sample was put on the bus.
std::atomic<Clock::time_point> newest_sample;

/// Drives and IMU on their end of the bus, a millisecond at once.
void run_devices(const RigConfiguration& configuration, CanBus& bus, const std::atomic<bool>& ends) {
  std::vector<simulated::DriveOptions> drives;
  for (const odrive::Node node : configuration.nodes()) {
    simulated::DriveOptions drive;
    drive.node = node;
    drive.watchdog = milliseconds(0);
    drives.push_back(drive);
  }
  simulated::ImuOptions imu;
  imu.frequency = configuration.imu->rate;
  simulated::SimulatedBus devices(drives, imu, 1, Clock::now());
  for (MonotonicTime now = Clock::now(); !ends; now += milliseconds(1)) {
    std::this_thread::sleep_until(now);
    while (const auto got = bus.receive()) static_cast<void>(devices.send(got->frame));
    devices.advance(now);
    while (const auto got = devices.receive()) {
      const bool ends_sample = got->frame.id.value == xsens::Ids().acceleration;
      if (ends_sample) newest_sample = Clock::now();
      static_cast<void>(bus.send(got->frame));
    }
  }
}

/// The rig's end.
class Host {
 public:
  Host(const RigConfiguration& configuration, CanBus& bus) : bus_(bus), rig_(configuration, Clock::now()) {}

  /// Error: what the rig refuses.
  Status run_until(Clock::time_point end) {
    for (;;) {
      const auto got = receive_until(bus_, std::min(end, rig_.next_due()));
      const MonotonicTime now = Clock::now();
      if (now >= end) return {};
      if (got) {
        rig_.receive(got->frame, now);
        ++frames;
      }
      if (now - commanded_ > milliseconds(20)) {
        commanded_ = now;
        if (Status done = command(rig_command::Stay(), now); !done) return done;
      }
      rig_.advance(now);
      send();
    }
  }
  Status command(decltype(RigCommand::what) what, MonotonicTime now = Clock::now()) {
    return rig_.take({"bench", std::move(what)}, now);
  }
  template <typename State>
  Status run_until_both_are() {
    const auto end = Clock::now() + std::chrono::seconds(20);
    while (!is<State>(AxisName::kPan) || !is<State>(AxisName::kTilt)) {
      if (Clock::now() > end) return fail(ErrorCode::kIo, "the rig did not get ready: " + rig_.describe());
      if (Status done = run_until(Clock::now() + milliseconds(10)); !done) return done;
    }
    return {};
  }

  uint64_t frames = 0;
  std::vector<double> waits;  ///< from a sample to the setpoint [ms]

 private:
  template <typename State>
  [[nodiscard]] bool is(AxisName name) const {
    return std::holds_alternative<State>(rig_.axis(name).state());
  }
  void send() {
    for (const OutgoingFrame& out : rig_.take_frames()) {
      static_cast<void>(bus_.send(out.frame, out.urgency));
      ++frames;
      constexpr uint32_t kSetInputPosition = 0x0C;
      if ((out.frame.id.value & 0x1FU) == kSetInputPosition)
        waits.push_back(
            std::chrono::duration<double, std::milli>(Clock::now() - newest_sample.load()).count());
    }
  }

  CanBus& bus_;
  Rig rig_;
  MonotonicTime commanded_;
};

Status measure(const std::string& path, int seconds) {
  auto configuration = read_rig_configuration(path);
  if (!configuration) return tl::unexpected(configuration.error());
  if (!configuration->imu) return fail(ErrorCode::kUsage, "the rig of that configuration has no IMU");
  // A machine that does other things too is no fault here.
  configuration->commander_deadline = configuration->imu_deadline = configuration->drive_deadline =
      milliseconds(2000);
  auto pair = make_bus_pair();
  if (!pair) return tl::unexpected(pair.error());
  std::atomic<bool> ends = false;
  std::thread devices(run_devices, *configuration, std::ref(*pair->second), std::cref(ends));
  Host host(*configuration, *pair->first);
  const auto steps = [&]() -> Status {
    if (Status done = host.run_until(Clock::now() + milliseconds(300)); !done) return done;
    if (Status done = host.command(rig_command::Home()); !done) return done;
    if (Status done = host.run_until_both_are<axis_state::Idle>(); !done) return done;
    if (Status done = host.run_until(Clock::now() + milliseconds(100)); !done) return done;
    if (Status done = host.command(rig_command::Activate()); !done) return done;
    if (Status done = host.run_until_both_are<axis_state::Active>(); !done) return done;
    if (Status done = host.command(rig_command::Aim{pointing::Lock()}); !done) return done;
    host.frames = 0;
    host.waits.clear();
    const double before = cpu_seconds();
    if (Status done = host.run_until(Clock::now() + std::chrono::seconds(seconds)); !done) return done;
    const double cpu = cpu_seconds() - before;
    std::sort(host.waits.begin(), host.waits.end());
    if (host.waits.empty()) return fail(ErrorCode::kIo, "the rig sent no setpoint");
    const auto quantile = [&](size_t percent) {
      return host.waits.at((host.waits.size() - 1) * percent / 100);
    };
    std::printf("%.0f frames/s, %.1f %% of a core; gyro sample -> setpoint p50 %.2f ms, p95 %.2f ms\n",
                static_cast<double>(host.frames) / seconds, 100 * cpu / seconds, quantile(50), quantile(95));
    return {};
  };
  const Status done = steps();
  ends = true;
  devices.join();
  return done;
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  CLI::App app("What a rig costs a host, and how fast it answers its gyro.");
  std::string path;
  int seconds = 10;
  app.add_option("--config", path, "configuration of a rig, for instance hw/rig/shoulder.yaml")->required();
  app.add_option("--seconds", seconds, "how long")->check(CLI::Range(1, 3600));
  CLI11_PARSE(app, argc, argv);
  if (const cairn::Status done = cairn::measure(path, seconds); !done) {
    std::fprintf(stderr, "cairn-rig-bench: %s\n", done.error().message.c_str());
    return 1;
  }
  return 0;
}
