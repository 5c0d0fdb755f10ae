// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/server_options.h"

#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <utility>
#include <vector>

#include "common/base/configuration_file.h"
#include "common/base/help_formats.h"
#include "common/base/unknown_word.h"
#include "common/base/version.h"
#include "common/io/distinct_files.h"
#include "server/endpoint/server_option_rows.h"

namespace cairn {
namespace {

constexpr int kUsageExit = 2;
constexpr int kConfigurationExit = 3;

constexpr const char* kDescription = "Serves maps to cairn-track clients.";
constexpr const char* kFooter =
    "The configuration file is YAML with the names of the long options as keys, e.g. `domain: 3`,\n"
    "and the constants of the engines under `map_maker:` and `relocalization:`; --print-config tells all.\n"
    "SIGINT, SIGTERM and, without nohup, SIGHUP end it in order: all that has changed is kept.\n"
    "Exit codes: 0 ok, 1 failed, 2 usage, 3 configuration, or a file that cannot be read or\n"
    "written, 5 refused (the domain's port or the store is in use)\n\n"
    "Examples:\n"
    "  cairn-server                                  for trackers on this machine\n"
    "  cairn-server --profile wifi --listen wlan0    for trackers on a wireless network\n"
    "  cairn-server --config cairn-server.yaml --domain 7 -v";

std::vector<std::string> option_names() {
  std::vector<std::string> names;
  for (const ServerOptionRow& row : server_option_rows()) {
    names.emplace_back(row.name);
    if (row.older_name != nullptr) names.emplace_back(row.older_name);
  }
  return names;
}

/// Older names become today's. Errors: kConfiguration, where a file has both.
Status rename_older(ConfigurationWords* words) {
  for (const ServerOptionRow& row : server_option_rows()) {
    const auto older = row.older_name != nullptr ? words->find(row.older_name) : words->end();
    if (older == words->end()) continue;
    if (words->contains(row.name))
      return fail(ErrorCode::kConfiguration,
                  fmt::format("{} and {} are one option", row.name, row.older_name));
    words->emplace(row.name, std::move(older->second));
    words->erase(row.older_name);
  }
  return {};
}

/// The constants that a configuration file may set, by heading.
OptionList engines_of(ServerOptions* options) {
  return OptionList()
      .add_part("map_maker", list_options(&options->mapping))
      .add_part("relocalization", list_options(&options->relocalization));
}

EarlyExit complaint(int code, const std::string& message) {
  return {code, "cairn-server: " + message + "\ncairn-server --help lists all options\n"};
}

/// --listen takes the place of the interface that a profile names.
bool stays_on_this_machine(const ServerOptions& options) {
  const std::string& listen = options.listen;
  return options.profile == "loopback" && (listen.empty() || listen == "lo" || listen.starts_with("127."));
}

/// `words` has only names of server_option_rows(). Errors: kConfiguration for a value, kUsage for what is not
/// to be had at all.
Status translate(const ConfigurationWords& words, ServerOptions* options) {
  const auto rows = server_option_rows();
  for (const auto& [name, value] : words) {
    const auto row =
        std::ranges::find(rows, name, [](const ServerOptionRow& r) { return std::string(r.name); });
    if (row->read == nullptr) return fail(ErrorCode::kUsage, name + ": not available yet");
    const char* why = value.empty() ? "needs a value" : row->expected;
    if (value.empty() || !row->read(value, options))
      return fail(ErrorCode::kConfiguration, fmt::format("{} '{}': {}", name, value, why));
  }
  if (!words.contains("lockstep")) options->lockstep = stays_on_this_machine(*options);
  return {};
}

/// The options that command line and file give together.
struct Merged {
  ServerOptions options;
  ConfigurationWords given;
};

std::variant<Merged, EarlyExit> merge(const ConfigurationWords& from_line, const std::string& config,
                                      int verbosity) {
  ServerOptions options;
  ConfigurationWords words;
  if (!config.empty()) {
    auto from_file = read_configuration(config, option_names(), engines_of(&options));
    if (!from_file) return complaint(kConfigurationExit, from_file.error().message);
    if (const auto renamed = rename_older(&*from_file); !renamed)
      return complaint(kConfigurationExit, config + ": " + renamed.error().message);
    // Judged by itself, so that the complaint tells where the mistake is.
    ServerOptions by_itself;
    if (const auto judged = translate(*from_file, &by_itself); !judged)
      return complaint(exit_code(judged.error().code), config + ": " + judged.error().message);
    words = std::move(*from_file);
  }
  for (const auto& [name, value] : from_line) words.insert_or_assign(name, value);
  if (const auto translated = translate(words, &options); !translated)
    return complaint(kUsageExit, "--" + translated.error().message);
  options.verbosity = verbosity;
  if (!options.stats.empty()) {
    std::vector<NamedFile> read;
    if (!config.empty()) read.push_back({"--config", config});
    if (!options.wearers.empty()) read.push_back({"--wearers", options.wearers});
    if (const auto distinct = check_distinct({{"--stats", options.stats}}, read); !distinct)
      return complaint(kUsageExit, distinct.error().message);
  }
  return Merged{std::move(options), std::move(words)};
}

/// Prints the configuration. A value that was not given and depends on something else is a comment, so that
/// whoever reads the file with another profile or on another machine has what holds there.
EarlyExit print(Merged merged) {
  auto& [options, given] = merged;
  std::vector<ConfigurationLine> lines;
  for (const ServerOptionRow& row : server_option_rows()) {
    const std::string value = row.write(options);
    const bool is_set = !value.empty() && (!row.depends || given.contains(row.name));
    if (row.read != nullptr) lines.push_back({row.name, value.empty() ? "not given" : value, is_set});
  }
  return {0, write_configuration("cairn-server", lines, engines_of(&options))};
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
  bool prints_config = false;
  ConfigurationWords words;
  app.add_option("--config", config, "settings; what the command line says wins")->type_name("FILE");
  app.add_flag("--print-config", prints_config,
               "prints all settings as --config reads them, the engines' constants included, and ends");
  for (const ServerOptionRow& row : server_option_rows()) {
    const std::string help = row.read != nullptr ? row.help : std::string(row.help) + " (not available yet)";
    const std::string older = row.older_name != nullptr ? std::string(",--") + row.older_name : "";
    app.add_option_function<std::string>(
           std::string("--") + row.name + older,
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
  auto merged = merge(words, config, (verbose ? 1 : 0) - (quiet ? 1 : 0));
  if (auto* exit = std::get_if<EarlyExit>(&merged)) return std::move(*exit);
  if (prints_config) return print(std::get<Merged>(std::move(merged)));
  return std::get<Merged>(std::move(merged)).options;
}

}  // namespace cairn
