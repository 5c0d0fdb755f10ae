// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>

namespace cairn {

/// "unknown argument 'X'; did you mean Y?" when a command line that could not be parsed has a word that is no
/// option and no command: that is what is wrong with it, whatever is missing besides. Nothing
/// for --help and --version. `app`: the program's, whose parse() threw `error`.
[[nodiscard]] std::optional<std::string> unknown_word(const CLI::App& app, const CLI::ParseError& error);

/// Says what the command line asked for (--help, --version, on stdout) or what is wrong with it (on stderr,
/// safe for a terminal whatever the words are). The exit code: 0 or that of wrong usage.
[[nodiscard]] int end_of_parse(const CLI::App& app, const CLI::ParseError& error);

}  // namespace cairn
