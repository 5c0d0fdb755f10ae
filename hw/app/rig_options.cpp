// SPDX-License-Identifier: Apache-2.0
#include "hw/app/rig_options.h"

#include <CLI/CLI.hpp>
#include <memory>

#include "common/base/help_formats.h"
#include "common/base/unknown_word.h"
#include "common/base/version.h"
#include "common/map/ids.h"
#include "common/wire/network_path.h"
#include "common/wire/security.h"

namespace cairn {
namespace {

constexpr int kMostTimeScale = 100;

constexpr const char* kFooter =
    "SIGINT, SIGTERM and, without nohup, SIGHUP let the drives go and end it; SIGUSR1 is an emergency stop:\n"
    "  pkill -USR1 -x cairn-rig        (and from anywhere: cairnctl rig NAME stop)\n"
    "Exit codes: 0 ok, 1 a check of doctor failed, 2 usage, 3 configuration, or an interface that is not "
    "there,\n"
    "5 refused (another cairn-rig of this host and domain; a calibration that cannot be), 130 interrupted\n\n"
    "Examples:\n"
    "  sudo ip link set can0 up type can bitrate 500000 restart-ms 100\n"
    "  cairn-rig doctor --can can0 --config shoulder.yaml\n"
    "  cairn-rig calibrate --can can0 --config shoulder.yaml   (beside `cairn-track --rig shoulder`)\n"
    "  cairn-rig --can can0 --config shoulder.yaml --server maps.example.org\n"
    "without hardware, and without CAN:\n"
    "  cairn-rig simulate --config shoulder.yaml --camera /tmp/shoulder\n"
    "or with it:\n"
    "  sudo ip link add vcan0 up type vcan\n"
    "  cairn-rig simulate --can vcan0 --config shoulder.yaml --fault stuck-pan@20 &\n"
    "  cairn-rig --can vcan0 --config shoulder.yaml\n"
    "hw/BRINGUP.md of the source describes wiring and first steps, hw/rig/shoulder.yaml has all keys of a "
    "configuration.";

std::string check_name(const std::string& text) {
  return is_valid_name(text) ? "" : "'" + text + "': expected 1 to 32 of a-z, 0-9 and -";
}

/// Adds the options that all tasks need.
void add_bus_options(CLI::App* app, RigOptions* options) {
  app->add_option("--can", options->can,
                  "interface of the bus, can0 say; needed where devices are not simulated; fd:N is an end of "
                  "a pair of sockets that the "
                  "process was started with")
      ->type_name("IFACE");
  app->add_option("--config", options->config, "what the rig is, YAML")->type_name("FILE")->required();
  app->add_flag("--print-config", options->prints_config,
                "prints the rig as --config reads it, with --name and defaults, and ends");
  app->add_option("--time-scale", options->time_scale,
                  "a second of the rig takes so many: for simulated devices on a slow machine")
      ->check(CLI::Range(1, kMostTimeScale))
      ->capture_default_str();
}

struct Loudness {
  bool verbose = false;
  bool quiet = false;
};

/// Adds the options of tasks that are heard on the network.
void add_network_options(CLI::App* app, RigOptions* options, Loudness* loudness) {
  auto& network = options->network;
  app->add_option("--name", options->name, "of the rig [that of its keys, else of the file]")
      ->check(check_name);
  app->add_option("--domain", network.domain, "DDS domain")
      ->check(CLI::Range(0U, wire::kMaxDomain))
      ->capture_default_str();
  app->add_option("--server", network.server_host, "host of cairn-server")->capture_default_str();
  network.profile.clear();
  app->add_option("--profile", network.profile, "network [loopback for localhost, wifi otherwise]")
      ->type_name("loopback|wifi|FILE");
  app->add_option("--listen", network.listen,
                  "network interface or address of this machine [that of the route to the server]")
      ->type_name("IFACE|ADDR");
  app->add_option("--security", network.security, wire::kSecurityHelp)->type_name("DIR");
  app->add_flag("-v,--verbose", loudness->verbose, "more words");
  app->add_flag("-q,--quiet", loudness->quiet, "warnings only");
}

void describe(CLI::App* app, RigOptions* options) {
  app->footer(kFooter);
  app->formatter(std::make_shared<OwnFooter>());
  app->set_version_flag("--version", "cairn-rig " + std::string(version()));
  app->require_subcommand(0, 1);
  CLI::App* doctor = app->add_subcommand(
      "doctor", "bring-up step by step: interface, bus, drives, IMU; it listens, nothing moves");
  doctor->callback([options] { options->task = RigTask::kDoctor; });
  add_bus_options(doctor, options);
  CLI::App* simulate = app->add_subcommand(
      "simulate",
      "drives and IMU as nodes of the bus, on a wearer who walks; what happens to them is told on stdout. "
      "Without --can there is no bus: the rig's own program is in the process too, with its options");
  simulate->callback([options] { options->task = RigTask::kSimulate; });
  add_bus_options(simulate, options);
  simulate
      ->add_option("--camera", options->camera,
                   "socket that tells where the camera is: `cairn-track --source 'sim:shoulder?rig=PATH'`")
      ->type_name("PATH");
  simulate->add_option("--seed", options->seed, "of noise and chance")->capture_default_str();
  CLI::App* calibrate = app->add_subcommand(
      "calibrate",
      "finds how camera and IMU sit on the head and what lies between their clocks, with the map of the "
      "camera's tracker (cairn-track --rig), and writes it into FILE; the axes move");
  calibrate->callback([options] { options->task = RigTask::kCalibrate; });
  add_bus_options(calibrate, options);
  calibrate->add_flag("--yes", options->agreed, "the axes may move: do not ask");
}

}  // namespace

std::variant<RigOptions, int> parse_rig_options(int argc, const char* const* argv) {
  RigOptions options;
  CLI::App app("Moves a camera in pan and tilt: drives and an IMU on a CAN bus, as commanders ask.",
               "cairn-rig");
  std::vector<std::string> faults;
  Loudness words;
  describe(&app, &options);
  app.get_subcommand("simulate")
      ->add_option(
          "--fault", faults,
          "of the devices, WHAT@SECONDS or WHAT@SECONDS+DURATION; also read as WHAT or WHAT+DURATION, a "
          "line each, from stdin. WHAT: " +
              list_of_device_faults() +
              ". Lines of stdin tell the wearer, too: walk HZ [DEG/S], stand, turn DEGREES [SECONDS]")
      ->type_name("WHAT@S");
  const std::string task = argc < 2 ? "" : argv[1];
  if (task == "calibrate" || task == "simulate") {
    add_network_options(app.get_subcommand(task), &options, &words);
  } else if (task != "doctor") {
    add_bus_options(&app, &options);
    add_network_options(&app, &options, &words);
  }
  try {
    app.parse(argc, argv);
    const bool needs_bus = options.task != RigTask::kSimulate && !options.prints_config;
    if (needs_bus && options.can.empty()) throw CLI::RequiredError("--can");
  } catch (const CLI::ParseError& error) {
    return end_of_parse(app, error);
  }
  for (const std::string& text : faults) {
    auto fault = parse_timed_fault(text);
    if (!fault) {
      say_error("cairn-rig", "--fault " + fault.error().message);
      return exit_code(ErrorCode::kUsage);
    }
    options.faults.push_back(*fault);
  }
  auto& network = options.network;
  network.role = wire::Role::kRig;
  if (network.profile.empty()) network.profile = wire::default_profile(network.server_host);
  options.verbosity = (words.verbose ? 1 : 0) - (words.quiet ? 1 : 0);
  return options;
}

}  // namespace cairn
