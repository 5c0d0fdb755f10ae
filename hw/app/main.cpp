// SPDX-License-Identifier: Apache-2.0
// cairn-rig: the bridge between commanders and the drives and IMU of a rig.
#include <chrono>
#include <csignal>
#include <cstdio>
#include <exception>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>

#include "common/base/ending_signals.h"
#include "common/base/log.h"
#include "common/wire/log_redirect.h"
#include "common/wire/security.h"
#include "hw/app/calibrate.h"
#include "hw/app/calibration_drive.h"
#include "hw/app/doctor.h"
#include "hw/app/offset_watch.h"
#include "hw/app/rig_host.h"
#include "hw/app/rig_options.h"
#include "hw/app/simulate.h"
#include "hw/can/late_bus.h"
#include "hw/can/socket_bus.h"

namespace cairn {
namespace {

int complain(const Error& error) {
  say_error("cairn-rig", error.message);
  return exit_code(error.code);
}

/// Starts the host, and hands to `offsets` what the gyro and the tracker of the rig's camera say from now on.
void watch_offset(RigHost& host, ScaledClock clock, OffsetWatch* offsets) {
  host.start({[&host, offsets](const wire::RigState&) { offsets->sense(host.loop().take_gyro()); },
              [clock, offsets](const wire::TrackerStateMessage& state) {
                const TourPose pose = pose_of(state, {clock.at(state.frame_time).time_since_epoch().count()});
                if (pose.is_tracked) offsets->see({pose.when, pose.map_from_camera}, state.session);
              }});
}

/// A rig at work, with what watches it.
class Service {
 public:
  [[nodiscard]] static Result<std::unique_ptr<Service>> start(const RigOptions& options,
                                                              const RigConfiguration& configuration,
                                                              std::unique_ptr<CanBus> bus,
                                                              const Logger& log) {
    const std::string bus_name = options.can.empty() ? "simulated devices" : options.can;
    const ScaledClock clock(options.time_scale);
    auto host = RigHost::open({configuration, bus_name, clock, log}, options.network, std::move(bus));
    if (!host) return tl::unexpected(host.error());
    std::unique_ptr<Service> service(new Service(*std::move(host), configuration.name, log));
    watch_offset(*service->host_, clock, &*service->offsets_);
    log->info("rig {} on {}, ready on domain {}, UDP port {}", configuration.name, bus_name,
              options.network.domain, wire::rig_port(options.network.domain));
    return service;
  }
  /// Emergency stop.
  void stop() {
    host_->loop().stop();
    log_->warn("emergency stop by signal; `cairnctl rig {} clear` ends it", name_);
  }
  /// The process is to end well.
  void close() {
    log_->info("letting the drives go");
    host_->leave_network();  // nobody speaks to the watch any more
    offsets_.reset();        // nor it to the rig
    host_->close(0);
  }
  ~Service() { host_->leave_network(); }
  Service(const Service&) = delete;
  Service& operator=(const Service&) = delete;

 private:
  Service(std::unique_ptr<RigHost> host, std::string name, Logger log)
      : name_(std::move(name)), log_(std::move(log)), host_(std::move(host)) {
    offsets_.emplace(
        log_, [loop = &host_->loop()](const wire::RigCameraClock& clock) { loop->set_camera_clock(clock); });
  }

  std::string name_;
  Logger log_;
  std::unique_ptr<RigHost> host_;
  std::optional<OffsetWatch> offsets_;  ///< its thread speaks to the host, and the host's to it
};

/// Beside a bus: until a signal ends it.
int serve(const RigOptions& options, const RigConfiguration& configuration, const sigset_t& signals) {
  const Logger log = make_logger("cairn-rig", options.verbosity);
  const wire::LogRedirect middleware_log(log);
  bool ended = false;
  bool stopped = false;  // before there was a rig
  const auto is_ended_after = [&](std::chrono::milliseconds time) {
    const timespec wait{time.count() / 1000, time.count() % 1000 * 1'000'000};
    const int signal = sigtimedwait(&signals, nullptr, &wait);
    stopped |= signal == SIGUSR1;
    return ended = signal > 0 && signal != SIGUSR1;
  };
  auto bus = open_late_can_bus(
      {.tell = [&log](const std::string& words) { log->warn("{}", words); }, .gives_up = is_ended_after},
      [&options] { return open_can_bus(options.can); });
  if (!bus && ended) return 0;
  if (!bus) return complain(bus.error());
  const auto service = Service::start(options, configuration, std::move(*bus), log);
  if (!service) return complain(service.error());
  if (stopped) (*service)->stop();
  int signal = 0;
  while (sigwait(&signals, &signal) == 0 && signal == SIGUSR1) (*service)->stop();
  (*service)->close();
  return 0;
}

/// Devices on a bus.
int simulate(const RigOptions& options, const RigConfiguration& configuration, const sigset_t& signals) {
  auto bus = open_can_bus(options.can);
  if (!bus) return complain(bus.error());
  const Status done = run_simulation(options, configuration, signals, **bus, {});
  return done ? 0 : complain(done.error());
}

/// Devices and the rig's own program in one process: a pair of sockets is their bus.
int simulate_all(const RigOptions& options, const RigConfiguration& configuration, const sigset_t& signals) {
  const Logger log = make_logger("cairn-rig", options.verbosity);
  const wire::LogRedirect middleware_log(log);
  auto ends = make_bus_pair();
  if (!ends) return complain(ends.error());
  const auto service = Service::start(options, configuration, std::move(ends->first), log);
  if (!service) return complain(service.error());
  const Status done = run_simulation(options, configuration, signals, *ends->second,
                                     {[&] { (*service)->stop(); }, [&] { (*service)->close(); }});
  return done ? 0 : complain(done.error());
}

int run(int argc, char** argv) {
  const auto parsed = parse_rig_options(argc, argv);
  if (const int* code = std::get_if<int>(&parsed)) return *code;
  const auto& options = std::get<RigOptions>(parsed);
  auto configuration = read_rig_configuration(options.config);
  if (!configuration) return complain(configuration.error());
  if (!options.name.empty()) configuration->name = options.name;
  if (!options.network.security.empty()) {
    auto name = wire::secured_name(options.network.security, "rig", options.name);
    if (!name) return complain({name.error().code, "--security " + name.error().message});
    configuration->name = *std::move(name);
  }
  if (options.prints_config) {
    std::fputs(write_rig_configuration(*configuration).c_str(), stdout);
    return 0;
  }
  sigset_t signals = block_ending_signals();  // before any thread
  sigaddset(&signals, SIGUSR1);               // the emergency stop, which ends no process
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  // A reader of our words that has gone is no reason to go, least of all with drives that move.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  switch (options.task) {
    case RigTask::kDoctor:
      return run_doctor(options, *configuration);
    case RigTask::kSimulate:
      return options.can.empty() ? simulate_all(options, *configuration, signals)
                                 : simulate(options, *configuration, signals);
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
