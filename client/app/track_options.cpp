// SPDX-License-Identifier: Apache-2.0
#include "client/app/track_options.h"

#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <map>
#include <utility>

#include "common/base/configuration_file.h"
#include "common/base/help_formats.h"
#include "common/base/unknown_word.h"
#include "common/base/version.h"
#include "common/map/ids.h"
#include "common/wire/participant.h"
#include "common/wire/security.h"

namespace cairn {
namespace {

constexpr int kUsageExit = 2;
constexpr int kConfigurationExit = 3;
constexpr std::string_view kAuto = "auto";
constexpr std::string_view kAutoFrom = "auto:";
constexpr std::string_view kExactly = "exact:";

constexpr const char* kDescription =
    "Tracks a camera against the maps of a cairn-server, and helps them grow.";
constexpr const char* kFooter =
    "`cairn-track calibrate --help`: a calibration from a printed board\n\n"
    "Sources: tum:DIR, euroc:DIR, images:DIR?fps=30, video:FILE?times=FILE, v4l2:/dev/video0?size=640x480, "
    "sim:SCENARIO?seed=1\n"
    "images: takes times=FILE instead of fps=, and match=GLOB where images of several kinds lie side by "
    "side. unit=s|ms|us|ns: what the times of a list count (tum:, euroc:, times=). Videos are turned upright "
    "as players show them; their calibration is for that size.\n"
    "A builder begins a new map when it gets SIGUSR1 (kill -USR1); who makes no maps looks for one again.\n"
    "The configuration file has the names of the long options as keys, e.g. `domain: 3`, and the constants "
    "of\n"
    "the tracker under `tracker:` and those of a rig's commander under `commander:`; --print-config tells "
    "all.\n"
    "Outputs may be pipes: what nobody reads is left out, the run goes on and ends with 3.\n"
    "Exit codes: 0 ok; 1 a trajectory was asked for and no frame was tracked, or most were dropped; also an "
    "internal error; 2 usage, 3 configuration or a file, 4 no server, 5 refused, 6 damaged data, 130 "
    "interrupted\n\n"
    "Examples:\n"
    "  cairn-track --source v4l2:/dev/video0 --calibration camera.txt --video desk.mp4\n"
    "  cairn-track --source tum:recording --pace lockstep --trajectory poses.txt --stats stats.json";

const std::map<std::string, Pace> kPaces = {
    {"realtime", Pace::kRealtime}, {"lockstep", Pace::kLockstep}, {"max", Pace::kMax}};

const std::map<std::string, RigAim> kRigAims = {{"neutral", RigAim::kNeutral},
                                                {"follow", RigAim::kFollow},
                                                {"lock", RigAim::kLock},
                                                {"fixate", RigAim::kFixate},
                                                {"search", RigAim::kSearch}};

/// The words as the user types them; where they differ from TrackOptions, they are translated after parsing.
struct Words {
  TrackOptions options;
  std::string config;
  bool prints_config = false;
  std::string calibration;
  std::string saved_calibration;
  std::string role = "builder";
  std::string pace = "realtime";
  std::string name;
  std::string trajectory;
  std::string stats;
  std::string video;
  std::string labels;
  std::string rig_mode;
  std::string rig_search;
  std::string imu;
  std::optional<double> imu_time_offset;
  std::optional<int> lost_patience;
  bool verbose = false;
  bool quiet = false;
};

std::string check_name(const std::string& name) {
  return is_valid_name(name) ? "" : "'" + name + "' is not a name: 1 to 32 of a-z, 0-9 and '-'";
}

/// CLI11 takes -1 and what overflows for other numbers.
std::string check_seed(const std::string& text) {
  uint64_t seed = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seed);
  const bool is_number = error == std::errc() && end == text.data() + text.size();
  return is_number ? "" : "'" + text + "' is not a number from 0 to 18446744073709551615";
}

void declare_camera(CLI::App& app, Words& words) {
  auto& options = words.options;
  app.add_option("--source", options.source, "where frames come from (see below); needed")->type_name("URI");
  app.add_option(
         "--calibration", words.calibration,
         "camera.txt, or a calibration of Kalibr, OpenCV, ROS, ORB-SLAM, VINS, COLMAP, LSD-SLAM, DSO, KITTI "
         "or PTAM; FILE#NAME takes one of several cameras; auto: focal length and k1 are self-calibrated while "
         "the map grows, from nothing or from a rough FILE. A FILE without distortion is believed to 0.5 % and "
         "refined so; exact:FILE takes it as it is [what lies beside the source, else auto]")
      ->type_name("FILE|auto|auto:FILE|exact:FILE");
  app.add_option(
         "--imu", words.imu,
         "samples of the IMU on the camera, rows `time wx wy wz ax ay az` [ns or s, rad/s, m/s^2], or a "
         "folder as EuRoC's imu0 [what lies beside the images of euroc: and tum:]")
      ->type_name("FILE|DIR");
  app.add_option(
         "--imu-mount", words.options.imu.mount,
         "how the IMU sits: the quaternion that turns its axes to the camera's, or a file that says so: "
         "Kalibr's camchain (T_cam_imu), the camera's sensor.yaml (T_BS) [sensor.yaml of euroc:]")
      ->type_name("QX,QY,QZ,QW|FILE");
  app.add_option("--imu-time-offset", words.imu_time_offset,
                 "what is added to the IMU's times for the camera's [Kalibr's, else 0]")
      ->check(CLI::Range(-1e9, 1e9))
      ->type_name("SECONDS");
  app.add_option("--save-calibration", words.saved_calibration,
                 "where a camera that was calibrated is written [cairn-camera-NAME.yaml]")
      ->type_name("FILE");
}

void declare_network(CLI::App& app, Words& words) {
  auto& options = words.options;
  app.add_option("--server", options.server, "host of cairn-server")
      ->type_name("HOST")
      ->capture_default_str();
  app.add_option("--domain", options.domain, "DDS domain")
      ->check(CLI::Range(0U, wire::kMaxDomain))
      ->capture_default_str();
  app.add_option("--profile", options.profile, "network [loopback for localhost, wifi otherwise]")
      ->type_name("loopback|wifi|FILE");
  app.add_option("--listen", options.listen,
                 "network interface or address of this machine [that of the route to the server]")
      ->type_name("IFACE|ADDR");
  app.add_option("--security", options.security, wire::kSecurityHelp)->type_name("DIR");
}

void declare_client(CLI::App& app, Words& words) {
  auto& options = words.options;
  app.add_option("--name", words.name, "of this client [that of its keys, else host name and process id]")
      ->check(check_name)
      ->type_name("NAME");
  app.add_option("--wearer", options.wearer,
                 "who wears the camera: where another of the wearer's cameras is tracked, this one is looked "
                 "for first; on one host the window shows the others' images too (key o)")
      ->check(check_name)
      ->type_name("NAME");
  app.add_option("--role", words.role, "builder: maps grow; reader: only tracks")
      ->check(CLI::IsMember({"builder", "reader"}))
      ->capture_default_str();
  app.add_flag("!--no-proposals", options.proposes,
               "sends no images where a map takes proposals of who may not add to it, or is a reader");
  app.add_flag("--no-new-maps", options.no_new_maps, "adds to maps, starts none");
  app.add_option("--map", options.map, "for who makes no maps: the only map to track in [any]")
      ->check(check_name)
      ->type_name("NAME");
  app.add_option(
         "--lost-patience", words.lost_patience,
         fmt::format("a builder lost that long where no map is known begins one [{}]", options.lost_patience))
      ->check(CLI::Range(1, 3600))
      ->type_name("SECONDS");
}

void declare_run(CLI::App& app, Words& words) {
  auto& options = words.options;
  app.add_option("--pace", words.pace,
                 "realtime: by the time stamps; lockstep: repeatable; max: as fast as it goes")
      ->check(CLI::IsMember({"realtime", "lockstep", "max"}))
      ->capture_default_str();
  app.add_option("--seed", options.seed, "of all random choices")->check(check_seed)->capture_default_str();
  app.add_flag("--headless", options.headless, "no window, also where there is a display");
  app.add_option("--trajectory", words.trajectory,
                 "writes TUM rows; exit code 1 where there is no map or most frames are dropped")
      ->type_name("FILE");
  app.add_option("--stats", words.stats, "writes JSON")->type_name("FILE");
  app.add_option("--video", words.video, "writes the image with the tracker's view (.mp4, .mkv, .avi)")
      ->type_name("FILE");
  app.add_option("--labels", words.labels,
                 "with --headless: labels to be placed on the way, rows `timestamp x y text`: as if somebody "
                 "pointed at that pixel of the frame of that time and typed the text")
      ->type_name("FILE");
}

void declare_rig(CLI::App& app, Words& words) {
  auto& options = words.options;
  app.add_option("--rig", options.rig,
                 "name of the rig on this host that carries the camera: this tracker commands it, and has it "
                 "search when lost")
      ->check(check_name)
      ->type_name("NAME");
  app.add_option(
         "--rig-mode", words.rig_mode,
         "neutral: ahead, as the wearer points it, no search; follow: level, slowly with the wearer; "
         "lock: the direction it has; fixate: the map point in the middle of the image; search [follow]")
      ->check(CLI::IsMember({"neutral", "follow", "lock", "fixate", "search"}));
  app.add_option("--rig-search", words.rig_search,
                 "how the rig of a lost camera searches after the directions where maps were tracked last: "
                 "spiral around where it began, or raster, in rows [spiral]")
      ->check(CLI::IsMember({"spiral", "raster"}))
      ->type_name("PATTERN");
  app.add_option("--fixate", options.fixated_label, "with --rig-mode fixate: the label of that text")
      ->type_name("LABEL");
}

void declare(CLI::App& app, Words& words) {
  declare_camera(app, words);
  declare_network(app, words);
  declare_client(app, words);
  declare_run(app, words);
  declare_rig(app, words);
  app.add_option("--config", words.config, "settings as YAML; what the command line says wins")
      ->type_name("FILE");
  app.add_flag("--print-config", words.prints_config,
               "prints all settings as --config reads them, the tracker's constants included, and ends");
  app.add_flag("-v,--verbose", words.verbose, "more words");
  app.add_flag("-q,--quiet", words.quiet, "warnings only");
  app.set_version_flag("--version", "cairn-track " + std::string(version()));
}

std::optional<std::filesystem::path> path_or_nothing(const std::string& text) {
  return text.empty() ? std::nullopt : std::optional<std::filesystem::path>(text);
}

ParseExit refusal(int code, const std::string& message) {
  return {code, "cairn-track: " + message + "\ncairn-track --help lists all options\n"};
}

ParseExit usage(const std::string& message) {
  return refusal(kUsageExit, message);
}

tl::unexpected<Error> misfit(std::string message) {
  return fail(ErrorCode::kUsage, std::move(message));
}

/// Why the words about the rig cannot be meant so; nothing: all is well.
std::optional<std::string> misuse_of_rig(const Words& words) {
  const TrackOptions& options = words.options;
  if (options.rig.empty()) {
    if (!words.rig_mode.empty()) return "--rig-mode: only with --rig NAME, whose mode it is";
    if (!words.rig_search.empty()) return "--rig-search: only with --rig NAME, which searches";
    if (!options.fixated_label.empty()) return "--fixate: only with --rig NAME, which is to look there";
    return std::nullopt;
  }
  if (words.pace != "realtime") return "--rig: only with --pace realtime; a rig moves by its own time";
  if (!options.fixated_label.empty() && words.rig_mode != "fixate")
    return "--fixate: only with --rig-mode fixate";
  if (!words.imu.empty() || !options.imu.mount.empty() || words.imu_time_offset) {
    return "--rig and --imu, --imu-mount, --imu-time-offset exclude each other: a rig sends the samples of "
           "its "
           "own IMU";
  }
  return std::nullopt;
}

/// kUsage for options that exclude each other or lack another one; what is wrong with keys.
Result<TrackOptions> translate(Words words) {
  if (auto misuse = misuse_of_rig(words)) return misfit(*std::move(misuse));
  TrackOptions options = std::move(words.options);
  if (!words.name.empty()) options.name = words.name;
  if (!options.security.empty()) {
    auto name = wire::secured_name(options.security, "client", words.name);
    if (!name) return fail(name.error().code, "--security " + name.error().message);
    options.name = *std::move(name);
  }
  options.reader = words.role == "reader";
  if (!options.map.empty() && options.makes_maps()) {
    return misfit("--map: only with --role reader or --no-new-maps; a builder begins a map of its own");
  }
  if (words.lost_patience && !options.makes_maps()) {
    return misfit(
        "--lost-patience: not with --role reader or --no-new-maps; only a builder begins a map when it "
        "is lost");
  }
  options.lost_patience = words.lost_patience.value_or(options.lost_patience);
  options.find_camera = words.calibration == kAuto || words.calibration.starts_with(kAutoFrom);
  if (options.find_camera && options.reader)
    return misfit("--calibration auto: a reader makes no keyframes, from which a camera is calibrated");
  options.exact_camera = words.calibration.starts_with(kExactly);
  if (words.calibration.starts_with(kAutoFrom))
    words.calibration.erase(0, kAutoFrom.size());
  else if (options.exact_camera)
    words.calibration.erase(0, kExactly.size());
  if (words.calibration.empty() && (options.find_camera || options.exact_camera))
    return misfit("--calibration auto:FILE, exact:FILE: FILE is missing");
  if (words.calibration != kAuto) options.calibration = path_or_nothing(words.calibration);
  options.saved_calibration = path_or_nothing(words.saved_calibration);
  if (options.saved_calibration && options.exact_camera)
    return misfit(
        "--save-calibration: the camera of --calibration exact:FILE is taken as it is; pass auto:FILE");
  options.labels = path_or_nothing(words.labels);
  if (options.labels && options.reader) return misfit("--labels: a reader places no labels");
  if (options.labels && !options.headless)
    return misfit("--labels: only with --headless; in the window, point and type");
  options.imu.samples = path_or_nothing(words.imu);
  if (words.imu_time_offset)
    options.imu.clock_offset = std::chrono::nanoseconds(std::llround(1e9 * *words.imu_time_offset));
  options.pace = kPaces.at(words.pace);
  if (!words.rig_mode.empty()) options.rig_aim = kRigAims.at(words.rig_mode);
  options.rig_search = wire::parse_rig_search(words.rig_search).value_or(options.rig_search);
  options.trajectory = path_or_nothing(words.trajectory);
  options.stats = path_or_nothing(words.stats);
  options.video = path_or_nothing(words.video);
  options.config = words.config;
  options.verbosity = (words.verbose ? 1 : 0) - (words.quiet ? 1 : 0);
  return options;
}

ParseExit parse_exit(const CLI::App& app, const CLI::ParseError& error) {
  if (dynamic_cast<const CLI::CallForHelp*>(&error) != nullptr) return {0, told_help(app)};
  if (dynamic_cast<const CLI::CallForVersion*>(&error) != nullptr)
    return {0, std::string(error.what()) + "\n"};
  return usage(unknown_word(app, error).value_or(error.what()));
}

/// The constants that a configuration file may set, by heading.
OptionList engines_of(TrackOptions* options) {
  return OptionList()
      .add_part("tracker", list_options(&options->tracker))
      .add_part("commander", list_options(&options->commander));
}

/// The default of an option, which --help tells in brackets at the end of its description.
std::string told_default(const std::string& description) {
  const size_t begin = description.rfind('[');
  if (!description.ends_with(']') || begin == std::string::npos) return "not given";
  return description.substr(begin + 1, description.size() - begin - 2);
}

/// The command line, declared and parsed once.
class CommandLine {
 public:
  explicit CommandLine(const std::string& client_name) {
    app_.footer(kFooter);
    words.options.name = client_name;
    declare(app_, words);
  }

  /// Why the process is to end now; nothing: the words are read.
  [[nodiscard]] std::optional<ParseExit> parse(std::vector<std::string> arguments) {
    std::reverse(arguments.begin(), arguments.end());  // CLI11 takes them from the back
    try {
      app_.parse(std::move(arguments));
    } catch (const CLI::ParseError& error) {
      complaint = unknown_word(app_, error).value_or(error.what());
      return parse_exit(app_, error);
    }
    return std::nullopt;
  }

  /// Names of the options that a configuration file may set.
  [[nodiscard]] std::vector<std::string> names() const {
    std::vector<std::string> names;
    for (const CLI::Option* option : settings()) names.push_back(name_of(*option));
    return names;
  }

  /// The arguments that a file gives for options that the command line did not give. kConfiguration for an
  /// option without a value, and for a flag that is neither true nor false.
  [[nodiscard]] Result<std::vector<std::string>> lacking(const ConfigurationWords& file) const {
    std::vector<std::string> arguments;
    for (const auto& [name, value] : file) {
      const CLI::Option& option = *app_.get_option("--" + name);
      if (option.count() > 0) continue;
      if (value.empty()) return fail(ErrorCode::kConfiguration, name + ": needs a value");
      if (is_flag(option) && value != "true" && value != "false")
        return fail(ErrorCode::kConfiguration, fmt::format("{} '{}': expected true or false", name, value));
      if (!is_flag(option)) {
        arguments.push_back(fmt::format("--{}={}", name, value));
      } else if (value == "true") {
        arguments.push_back("--" + name);
      }
    }
    return arguments;
  }

  /// All options, in the order of --help: as given, else their default; as a comment where that depends on
  /// other options or on the machine.
  [[nodiscard]] std::vector<ConfigurationLine> lines() const {
    std::vector<ConfigurationLine> lines;
    for (const CLI::Option* option : settings()) {
      const std::string fallback = option->get_default_str();
      if (is_flag(*option)) {
        lines.push_back({name_of(*option), is_on(*option) ? "true" : "false"});
      } else if (option->count() > 0) {
        lines.push_back({name_of(*option), option->results().back()});
      } else if (!fallback.empty()) {
        lines.push_back({name_of(*option), fallback});
      } else {
        lines.push_back({name_of(*option), told_default(option->get_description()), false});
      }
    }
    return lines;
  }

  Words words;
  std::string complaint;  ///< of the last parse() that failed

 private:
  static bool is_flag(const CLI::Option& option) { return option.get_expected_max() == 0; }
  /// Whether the flag that this option names is on: an option that denies it (`!--no-proposals`) is on where
  /// the flag's value is false.
  static bool is_on(const CLI::Option& option) {
    if (option.count() == 0) return false;
    const bool denies = !option.get_fnames().empty();
    return option.as<bool>() != denies;
  }
  static std::string name_of(const CLI::Option& option) { return option.get_lnames().front(); }
  [[nodiscard]] std::vector<const CLI::Option*> settings() const {
    return app_.get_options([](const CLI::Option* option) {
      const std::string name = name_of(*option);
      return name != "help" && name != "version" && name != "config" && name != "print-config";
    });
  }

  CLI::App app_{kDescription, "cairn-track"};
};

/// The options, checked; with --print-config the configuration as text.
std::variant<TrackOptions, ParseExit> end_of(const CommandLine& line, TrackOptions options) {
  if (line.words.prints_config)
    return ParseExit{0, write_configuration("cairn-track", line.lines(), engines_of(&options))};
  if (options.source.empty()) return usage("--source is required");
  return options;
}

/// Whether translate() finds this fault in the line's own words alone.
bool has_fault(const CommandLine& line, const Error& fault) {
  const auto alone = translate(line.words);
  return !alone && alone.error().message == fault.message;
}

}  // namespace

std::string default_client_name(std::string_view host_name, int process_id) {
  const std::string suffix = fmt::format("-{}", process_id);
  std::string name;
  for (const unsigned char c : host_name.substr(0, host_name.find('.'))) {
    name += std::isalnum(c) != 0 && c < 0x80 ? static_cast<char>(std::tolower(c)) : '-';
  }
  return (name.empty() ? "camera" : name.substr(0, kMaxNameLength - suffix.size())) + suffix;
}

std::variant<TrackOptions, ParseExit> parse_track_options(std::vector<std::string> arguments,
                                                          std::string_view host_name, int process_id) {
  const std::string client_name = default_client_name(host_name, process_id);
  CommandLine line(client_name);
  if (auto exit = line.parse(arguments)) return *std::move(exit);
  const std::string config = line.words.config;
  if (config.empty()) {
    auto options = translate(line.words);
    if (!options) return refusal(exit_code(options.error().code), options.error().message);
    return end_of(line, *std::move(options));
  }
  TrackOptions constants;
  const auto from_file = read_configuration(config, line.names(), engines_of(&constants));
  if (!from_file) return refusal(exit_code(from_file.error().code), from_file.error().message);
  auto merged = line.lacking(*from_file);
  if (!merged) return refusal(exit_code(merged.error().code), config + ": " + merged.error().message);
  CommandLine file(client_name);
  // The command line itself has been parsed: what is no value of an option is in the file.
  if (const auto exit = file.parse(*merged))
    return refusal(kConfigurationExit, config + ": " + file.complaint);
  merged->insert(merged->end(), arguments.begin(), arguments.end());
  CommandLine both(client_name);
  if (auto exit = both.parse(*merged)) return *std::move(exit);
  both.words.options.tracker = constants.tracker;
  both.words.options.commander = constants.commander;
  auto options = translate(both.words);
  if (options) return end_of(both, *std::move(options));
  const Error& fault = options.error();
  if (has_fault(line, fault)) return refusal(exit_code(fault.code), fault.message);
  if (has_fault(file, fault)) return refusal(kConfigurationExit, config + ": " + fault.message);
  return refusal(exit_code(fault.code),
                 fmt::format("{} (the command line and {} do not go together)", fault.message, config));
}

}  // namespace cairn
