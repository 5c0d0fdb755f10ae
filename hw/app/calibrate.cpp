// SPDX-License-Identifier: Apache-2.0
#include "hw/app/calibrate.h"

#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <cstdio>
#include <numbers>
#include <string>
#include <utility>

#include "common/base/log.h"
#include "common/wire/log_redirect.h"
#include "hw/app/calibration_drive.h"
#include "hw/app/input_lines.h"
#include "hw/app/rig_host.h"
#include "hw/can/socket_bus.h"
#include "hw/rig/calibration_file.h"

namespace cairn {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kInterrupted = 130;
constexpr int kLook = 50;  // [ms] between looks for a signal

int complain(const Error& error) {
  say_error("cairn-rig", error.message);
  return exit_code(error.code);
}

/// Tells whether one of `signals` has come; once one has, the answer stays.
class Interrupts {
 public:
  explicit Interrupts(const sigset_t& signals) : signals_(signals) {}
  bool operator()() {
    const timespec at_once{0, 0};
    if (!interrupted_) {
      const int signal = sigtimedwait(&signals_, nullptr, &at_once);
      interrupted_ = signal > 0;
      is_stop_ = signal == SIGUSR1;
    }
    return interrupted_;
  }
  /// Whether that signal is the emergency stop.
  [[nodiscard]] bool is_stop() const { return is_stop_; }

 private:
  sigset_t signals_;
  bool interrupted_ = false;
  bool is_stop_ = false;
};

bool ask(const std::string& what, Interrupts* interrupts) {
  std::fprintf(stderr, "%s\nMay they move now? [y/N] ", what.c_str());
  std::fflush(stderr);
  InputLines lines;
  while (!(*interrupts)() && !lines.has_ended()) {
    if (const auto line = lines.next()) return *line == "y" || *line == "yes";
    pollfd ready{STDIN_FILENO, POLLIN, 0};
    poll(&ready, 1, kLook);
  }
  return false;
}

void print(const TourFindings& found, bool has_imu) {
  const HandEye& eye = found.hand_eye;
  std::printf(
      "camera: %zu of %zu places fit, residual %.2f deg; it is at %.3f, %.3f, %.3f of the map's unit "
      "from where the axes cross, residual %.3f\n",
      eye.used, found.glances, eye.rotation_residual / kDegree, eye.camera_in_head.x(),
      eye.camera_in_head.y(), eye.camera_in_head.z(), eye.position_residual);
  if (found.gyro) {
    const CameraAndGyro& gyro = *found.gyro;
    std::printf("IMU: %.1f %% of the camera's turning explained, residual %.2f deg/s, bias %.2f deg/s%s\n",
                gyro.correlation * 100, gyro.residual / kDegree, gyro.bias.norm() / kDegree,
                gyro.rotation_known ? "" : "; it turned about one axis only: how it sits stays as it was");
    std::printf("clocks: a stamp of the camera lacks %.2f ms to the IMU's, known to %.2f ms\n",
                gyro.offset * 1000, gyro.sigma * 1000);
  }
  std::printf("%s", lines_of(found.calibration, has_imu).c_str());
  std::fflush(stdout);
}

Result<TourFindings> drive(RigHost& host, const RigOptions& options, const RigConfiguration& configuration,
                           SessionId session, Interrupts* interrupts) {
  CalibrationDrive drive(host, ScaledClock(options.time_scale), session);
  const auto hear = [](const std::string& words) {
    std::fprintf(stderr, "%s\n", words.c_str());
    std::fflush(stderr);
  };
  const auto agree = [&](const std::string& what) {
    if (!options.agreed) return ask(what, interrupts);
    hear(what);
    return true;
  };
  const auto is_interrupted = [&] {
    const bool interrupted = (*interrupts)();
    if (interrupts->is_stop()) host.loop().stop();
    return interrupted;
  };
  return drive.run(configuration, {agree, hear, is_interrupted});
}

}  // namespace

int run_calibration(const RigOptions& options, const RigConfiguration& configuration,
                    const sigset_t& signals) {
  if (!options.agreed && isatty(STDIN_FILENO) == 0) {
    say_error("cairn-rig", "calibrate moves the axes and nobody is there to be asked; say --yes");
    return exit_code(ErrorCode::kUsage);
  }
  if (Status writable = check_calibration_can_be_written(options.config); !writable)
    return complain(writable.error());
  const Logger log = make_logger("cairn-rig", options.verbosity - 1);  // the tour has words of its own
  const wire::LogRedirect middleware_log(log);
  auto bus = open_can_bus(options.can);  // without waiting: a person is there
  if (!bus) return complain(bus.error());
  const SessionId session = random_session();
  auto host = RigHost::open({configuration, options.can, ScaledClock(options.time_scale), log, session},
                            options.network, std::move(*bus));
  if (!host) return complain(host.error());
  Interrupts interrupts(signals);
  const auto found = drive(**host, options, configuration, session, &interrupts);
  int code = 0;
  if (found) {
    print(*found, configuration.imu.has_value());
    const Status written = write_calibration(options.config, found->calibration);
    if (written)
      std::fprintf(stderr, "written into %s; the former is %s.old\n", options.config.c_str(),
                   options.config.c_str());
    if (!written) code = complain(written.error());
  } else {
    code = complain(found.error());
    if (interrupts()) code = kInterrupted;
  }
  (*host)->close(code);
  return code;
}

}  // namespace cairn
