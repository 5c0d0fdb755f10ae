// SPDX-License-Identifier: Apache-2.0
#include "common/base/unknown_word.h"

#include <cstdio>
#include <cstdlib>
#include <sstream>
#include <vector>

#include "common/base/help_formats.h"
#include "common/base/log.h"
#include "common/base/result.h"
#include "common/base/suggestion.h"
#include "common/base/utf8.h"

namespace cairn {
namespace {

/// Options and commands of the program and of the command that was given.
void collect_words(const CLI::App& app, std::vector<std::string>* words) {
  for (const CLI::Option* option : app.get_options()) {
    for (const std::string& name : option->get_lnames()) words->push_back("--" + name);
  }
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; }))
    words->push_back(command->get_name());
  for (const CLI::App* given : app.get_subcommands()) collect_words(*given, words);
}

}  // namespace

std::optional<std::string> unknown_word(const CLI::App& app, const CLI::ParseError& error) {
  if (error.get_exit_code() == 0) return std::nullopt;
  std::vector<std::string> unknown = app.remaining(true);
  std::erase(unknown, "--");  // says where options end
  if (unknown.empty()) return std::nullopt;
  std::vector<std::string> words;
  collect_words(app, &words);
  const std::string word = unknown.front().substr(0, unknown.front().find('='));
  return "unknown argument '" + unknown.front() + "'" + did_you_mean(word, words);
}

int end_of_parse(const CLI::App& app, const CLI::ParseError& error) {
  if (const auto unknown = unknown_word(app, error)) {
    say_error(app.get_name(), *unknown);
    std::fputs("Run with --help for more information.\n", stderr);
    return exit_code(ErrorCode::kUsage);
  }
  if (dynamic_cast<const CLI::CallForHelp*>(&error) != nullptr && std::getenv("CAIRN_HELP_AS") != nullptr) {
    std::fputs(told_help(app).c_str(), stdout);
    return 0;
  }
  std::ostringstream help;
  std::ostringstream complaint;
  const bool is_help = app.exit(error, help, complaint) == 0;
  std::fputs(help.str().c_str(), stdout);
  std::fputs(many_lines(complaint.str()).c_str(), stderr);
  return is_help ? 0 : exit_code(ErrorCode::kUsage);
}

}  // namespace cairn
