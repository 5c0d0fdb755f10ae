// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/server_options.h"

#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "common/base/help_formats.h"
#include "common/base/suggestion.h"
#include "common/base/unknown_word.h"
#include "common/base/version.h"
#include "common/base/yaml_file.h"
#include "common/io/distinct_files.h"
#include "common/wire/participant.h"
#include "common/wire/security.h"

namespace cairn {
namespace {

constexpr int kUsageExit = 2;
constexpr int kConfigurationExit = 3;
constexpr uint64_t kMostMegabytes = uint64_t{1} << 40;

constexpr const char* kDescription = "Serves maps to cairn-track clients.";
constexpr const char* kFooter =
    "The configuration file is YAML with the names of the long options as keys, e.g. `domain: 3`.\n"
    "SIGINT, SIGTERM and, without nohup, SIGHUP end it in order: all that has changed is kept.\n"
    "Exit codes: 0 ok, 1 failed, 2 usage, 3 configuration, or a file that cannot be read or\n"
    "written, 5 refused (the domain's port or the store is in use)\n\n"
    "Examples:\n"
    "  cairn-server                                  for trackers on this machine\n"
    "  cairn-server --profile wifi --listen wlan0    for trackers on a wireless network\n"
    "  cairn-server --config cairn-server.yaml --domain 7 -v";

/// Values as words, from either source, by option name.
using Words = std::map<std::string, std::string>;

struct OptionRow {
  const char* name;
  const char* type;
  const char* help;
  bool available;
};
constexpr OptionRow kOptions[] = {
    {"domain", "N", "DDS domain, 0 to 230 [0]", true},
    {"listen", "IFACE|ADDR",
     "network interface or address of this machine [that of the profile; with wifi, of the default route]",
     true},
    {"profile", "loopback|wifi|FILE", "network profile [loopback]", true},
    {"seed", "N", "makes all ids reproducible; 0: random [0]", true},
    {"adjuster", "own|ceres", "solver of bundle adjustment; ceres is the slow, independent check [own]",
     true},
    {"relocalizer", "improved|paper",
     "how a lost camera is found: paper is the method of 2008, for comparison, which takes the image most "
     "alike for the place, wherever that is [improved]",
     true},
    {"max-maps", "N", "maps at most [1000]", true},
    {"max-maps-per-client", "N",
     "maps that one client may have made at most; deleted ones do not count [200]", true},
    {"max-memory", "MB", "memory of all maps at most [half of the machine's]", true},
    {"max-keyframes", "N", "keyframes of a map at most [2000]", true},
    {"max-labels", "N", "labels of a map at most, up to 1000 [1000]", true},
    {"keyframe-rate", "N",
     "keyframes a second that one client may offer in the long run, and 300 at once; 0: no limit [5]", true},
    {"question-rate", "N",
     "relocalization queries a second that one client may ask in the long run, and 100 at once; 0: no limit "
     "[20]",
     true},
    {"store", "DIR", "keeps maps across restarts, in this folder [in memory only]", true},
    {"rest-after", "SECONDS",
     "with --store, images of a map that nobody has worked on for so long are evicted from memory until "
     "somebody does; "
     "0: never [60]",
     true},
    {"drop-after", "SECONDS",
     "a map that its maker loses within a second, and in which nobody is found again, is deleted when its "
     "maker "
     "has been elsewhere for so long; 0: never [10]",
     true},
    {"keep-deleted", "DAYS",
     "with --store, maps that were deleted so long ago are removed for good; 0: `cairnctl maps purge` does "
     "that [0]",
     true},
    {"lockstep", "allow|refuse",
     "whether trackers may run with --pace lockstep, in which the server finishes all work of a map before "
     "it "
     "answers: for repeatable runs, at the cost of all others [allow with profile loopback, else refuse]",
     true},
    {"wearer-rule", "first|only",
     "where one camera of a wearer is tracked, the wearer's others are looked for first, or there only "
     "[first]",
     true},
    {"wearers", "FILE", "who wears which cameras: YAML, `anna: [hand-1, shoulder-1]` [as cairn-track claims]",
     true},
    {"stats", "FILE", "writes there at the end what the map makers did and how long it took, as JSON", true},
    {"security", "DIR", wire::kSecurityHelp, true},
    {"http", "ADDR:PORT", "dashboard, health and metrics", false},
};

std::vector<std::string> option_names() {
  std::vector<std::string> names;
  for (const OptionRow& row : kOptions) names.emplace_back(row.name);
  return names;
}

EarlyExit complaint(int code, const std::string& message) {
  return {code, "cairn-server: " + message + "\ncairn-server --help lists all options\n"};
}

template <typename Number>
std::optional<Number> to_number(const std::string& text) {
  Number value{};
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (problem != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

Result<Words> read_configuration(const std::string& path) {
  const auto loaded = load_yaml(path);
  if (!loaded) return tl::unexpected(loaded.error());
  const YAML::Node& root = *loaded;
  Words words;
  if (root.IsNull()) return words;
  if (!root.IsMap()) return fail(ErrorCode::kConfiguration, path + ": expected `key: value` lines");
  for (const auto& entry : root) {
    const std::string at = path + ":" + std::to_string(entry.first.Mark().line + 1) + ": ";
    if (!entry.first.IsScalar() || !entry.second.IsScalar()) {
      return fail(ErrorCode::kConfiguration, at + "expected `key: value`");
    }
    const auto key = entry.first.as<std::string>();
    const auto valid = option_names();
    if (std::find(valid.begin(), valid.end(), key) == valid.end()) {
      return fail(ErrorCode::kConfiguration,
                  fmt::format("{}unknown key '{}'{}", at, key, did_you_mean(key, valid)));
    }
    if (!words.emplace(key, entry.second.as<std::string>()).second) {
      return fail(ErrorCode::kConfiguration, fmt::format("{}'{}' is there twice", at, key));
    }
  }
  return words;
}

/// --listen takes the place of the interface that a profile names.
bool stays_on_this_machine(const ServerOptions& options) {
  const std::string& listen = options.listen;
  return options.profile == "loopback" && (listen.empty() || listen == "lo" || listen.starts_with("127."));
}

/// `words` has only names of kOptions. Errors: kConfiguration for a value, kUsage for what is not to be had
/// at all.
Result<ServerOptions> translate(const Words& words) {
  ServerOptions options;
  for (const auto& [name, value] : words) {
    const auto refuse = [&name = name, &value = value](const std::string& why) {
      return fail(ErrorCode::kConfiguration, fmt::format("{} '{}': {}", name, value, why));
    };
    const auto row = std::find_if(std::begin(kOptions), std::end(kOptions),
                                  [&name = name](const OptionRow& r) { return name == r.name; });
    if (!row->available) return fail(ErrorCode::kUsage, name + ": not available yet");
    if (value.empty()) return refuse("needs a value");
    if (name == "domain") {
      const auto domain = to_number<uint32_t>(value);
      if (!domain || *domain > wire::kMaxDomain) return refuse("expected a number from 0 to 230");
      options.domain = static_cast<int>(*domain);
    } else if (name == "seed") {
      const auto seed = to_number<uint64_t>(value);
      if (!seed) return refuse("expected a number from 0 on");
      options.seed = *seed;
    } else if (name == "adjuster") {
      if (value != "own" && value != "ceres") return refuse("expected own or ceres");
      options.adjuster = value == "own" ? Adjuster::kOwn : Adjuster::kCeres;
    } else if (name == "relocalizer") {
      if (value != "improved" && value != "paper") return refuse("expected improved or paper");
      options.relocalizer = value == "improved" ? RelocMethod::kImproved : RelocMethod::kPaper;
    } else if (name == "max-maps" || name == "max-maps-per-client") {
      const auto maps = to_number<size_t>(value);
      if (!maps || *maps == 0) return refuse("expected a number from 1 on");
      (name == "max-maps" ? options.max_maps : options.max_maps_per_client) = *maps;
    } else if (name == "max-memory") {
      const auto megabytes = to_number<uint64_t>(value);
      if (!megabytes || *megabytes == 0 || *megabytes > kMostMegabytes) {
        return refuse("expected a number of megabytes from 1 on");
      }
      options.max_memory_mb = *megabytes;
    } else if (name == "max-keyframes" || name == "max-labels") {
      const bool is_labels = name == "max-labels";
      const auto most = to_number<size_t>(value);
      if (!most || *most == 0 || (is_labels && *most > kMaxLabels))
        return refuse(is_labels ? "expected a number from 1 to 1000" : "expected a number from 1 on");
      (is_labels ? options.max_labels : options.max_keyframes) = *most;
    } else if (name == "keyframe-rate" || name == "question-rate") {
      const auto rate = to_number<double>(value);
      if (!rate || !(*rate >= 0) || !std::isfinite(*rate)) return refuse("expected a number from 0 on");
      (name == "keyframe-rate" ? options.rates.keyframes : options.rates.queries) = *rate;
    } else if (name == "rest-after" || name == "drop-after") {
      const auto seconds = to_number<uint32_t>(value);
      if (!seconds) return refuse("expected a number of seconds from 0 on");
      (name == "rest-after" ? options.idle_after : options.drop_after) = std::chrono::seconds(*seconds);
    } else if (name == "keep-deleted") {
      const auto days = to_number<uint16_t>(value);
      if (!days) return refuse("expected a number of days from 0 on");
      options.keep_deleted = std::chrono::hours(24) * *days;
    } else if (name == "lockstep") {
      if (value != "allow" && value != "refuse") return refuse("expected allow or refuse");
      options.lockstep = value == "allow";
    } else if (name == "wearer-rule") {
      if (value != "first" && value != "only") return refuse("expected first or only");
      options.wearer_policy = value == "first" ? WearerPolicy::kFirst : WearerPolicy::kOnly;
    } else if (name == "wearers") {
      options.wearers = value;
    } else if (name == "security") {
      options.security = value;
    } else if (name == "stats") {
      options.stats = value;
    } else if (name == "store") {
      options.store = value;
    } else if (name == "listen") {
      options.listen = value;
    } else if (name == "profile") {
      options.profile = value;
    }
  }
  if (!words.contains("lockstep")) options.lockstep = stays_on_this_machine(options);
  return options;
}

std::variant<ServerOptions, EarlyExit> merge(const Words& from_line, const std::string& config,
                                             int verbosity) {
  Words words;
  if (!config.empty()) {
    Result<Words> from_file = read_configuration(config);
    if (!from_file) return complaint(kConfigurationExit, from_file.error().message);
    // Judged by itself, so that the complaint tells where the mistake is.
    if (const auto judged = translate(*from_file); !judged) {
      return complaint(exit_code(judged.error().code), config + ": " + judged.error().message);
    }
    words = std::move(*from_file);
  }
  for (const auto& [name, value] : from_line) words.insert_or_assign(name, value);
  Result<ServerOptions> options = translate(words);
  if (!options) return complaint(kUsageExit, "--" + options.error().message);
  options->verbosity = verbosity;
  if (!options->stats.empty()) {
    std::vector<NamedFile> read;
    if (!config.empty()) read.push_back({"--config", config});
    if (!options->wearers.empty()) read.push_back({"--wearers", options->wearers});
    if (const auto distinct = check_distinct({{"--stats", options->stats}}, read); !distinct)
      return complaint(kUsageExit, distinct.error().message);
  }
  return *options;
}

EarlyExit parse_exit(const CLI::App& app, const CLI::ParseError& error) {
  if (dynamic_cast<const CLI::CallForHelp*>(&error) != nullptr) return {0, told_help(app)};
  if (dynamic_cast<const CLI::CallForVersion*>(&error) != nullptr)
    return {0, std::string(error.what()) + "\n"};
  return complaint(kUsageExit, unknown_word(app, error).value_or(error.what()));
}

}  // namespace

uint64_t half_of_memory_mb() {
  const auto pages = static_cast<uint64_t>(std::max(0L, sysconf(_SC_PHYS_PAGES)));
  const auto page_bytes = static_cast<uint64_t>(std::max(0L, sysconf(_SC_PAGESIZE)));
  return std::max<uint64_t>(1, pages * page_bytes / 2 / 1'000'000);
}

std::variant<ServerOptions, EarlyExit> parse_server_options(std::vector<std::string> arguments) {
  CLI::App app(kDescription, "cairn-server");
  app.footer(kFooter);
  std::string config;
  bool verbose = false;
  bool quiet = false;
  Words words;
  app.add_option("--config", config, "settings; what the command line says wins")->type_name("FILE");
  for (const OptionRow& row : kOptions) {
    const std::string help = row.available ? row.help : std::string(row.help) + " (not available yet)";
    app.add_option_function<std::string>(
           std::string("--") + row.name,
           [&words, &row](const std::string& value) { words[row.name] = value; }, help)
        ->type_name(row.type);
  }
  app.add_flag("-v,--verbose", verbose, "more words");
  app.add_flag("-q,--quiet", quiet, "warnings only");
  app.set_version_flag("--version", "cairn-server " + std::string(version()));
  std::reverse(arguments.begin(), arguments.end());  // CLI11 takes them from the back
  try {
    app.parse(std::move(arguments));
  } catch (const CLI::ParseError& error) {
    return parse_exit(app, error);
  }
  return merge(words, config, (verbose ? 1 : 0) - (quiet ? 1 : 0));
}

}  // namespace cairn
