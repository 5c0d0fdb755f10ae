// SPDX-License-Identifier: Apache-2.0
// cairn-rig: the bridge between commanders and the drives and IMU of a rig.
#include <csignal>
#include <cstdio>
#include <exception>
#include <memory>
#include <string>
#include <utility>
#include <variant>

#include "common/base/ending_signals.h"
#include "common/base/log.h"
#include "common/wire/log_redirect.h"
#include "hw/app/calibrate.h"
#include "hw/app/calibration_drive.h"
#include "hw/app/doctor.h"
#include "hw/app/offset_watch.h"
#include "hw/app/rig_host.h"
#include "hw/app/rig_options.h"
#include "hw/app/simulate.h"
#include "hw/can/socket_bus.h"

namespace cairn {
namespace {

int complain(const Error& error) {
  say_error("cairn-rig", error.message);
  return exit_code(error.code);
}

/// What the gyro and the tracker of the rig's camera say goes to `offsets`, from now on.
void watch_offset(RigHost& host, ScaledClock clock, OffsetWatch* offsets) {
  host.start({[&host, offsets](const wire::RigState&) { offsets->sense(host.loop().take_gyro()); },
              [clock, offsets](const wire::TrackerStateMessage& state) {
                const TourPose pose = pose_of(state, {clock.at(state.frame_time).time_since_epoch().count()});
                if (pose.is_tracked) offsets->see({pose.when, pose.map_from_camera});
              }});
}

/// Until a signal ends it.
int serve(const RigOptions& options, const RigConfiguration& configuration, sigset_t signals) {
  sigaddset(&signals, SIGUSR1);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  const Logger log = make_logger("cairn-rig", options.verbosity);
  const wire::LogRedirect middleware_log(log);
  auto bus = open_can_bus(options.can);
  if (!bus) return complain(bus.error());
  auto host = RigHost::open({configuration, options.can, ScaledClock(options.time_scale), log},
                            options.network, std::move(*bus));
  if (!host) return complain(host.error());
  RigLoop& loop = (*host)->loop();
  OffsetWatch offsets(log, [&loop](const wire::RigCameraClock& clock) { loop.set_camera_clock(clock); });
  watch_offset(**host, ScaledClock(options.time_scale), &offsets);
  log->info("rig {} on {}, ready on domain {}, UDP port {}", configuration.name, options.can,
            options.network.domain, wire::rig_port(options.network.domain));
  int signal = 0;
  while (sigwait(&signals, &signal) == 0 && signal == SIGUSR1) {
    loop.stop();
    log->warn("emergency stop by signal; `cairnctl rig {} clear` ends it", configuration.name);
  }
  log->info("letting the drives go");
  (*host)->close(0);
  return 0;
}

int run(int argc, char** argv) {
  const auto parsed = parse_rig_options(argc, argv);
  if (const int* code = std::get_if<int>(&parsed)) return *code;
  const auto& options = std::get<RigOptions>(parsed);
  auto configuration = read_rig_configuration(options.config);
  if (!configuration) return complain(configuration.error());
  if (!options.name.empty()) configuration->name = options.name;
  const sigset_t signals = block_ending_signals();  // before any thread
  // A reader of our words that has gone is no reason to go, least of all with drives that move.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  switch (options.task) {
    case RigTask::kDoctor:
      return run_doctor(options, *configuration);
    case RigTask::kSimulate:
      return run_simulation(options, *configuration, signals);
    case RigTask::kCalibrate:
      return run_calibration(options, *configuration, signals);
    case RigTask::kRun:
      break;
  }
  return serve(options, *configuration, signals);
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  try {
    return cairn::run(argc, argv);
  } catch (const std::exception& error) {
    cairn::say_error("cairn-rig", std::string("internal error: ") + error.what());
    return 1;
  }
}
