// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>
#include <string_view>

/// What --help says in other forms, made of the same words: nothing is written twice.
namespace cairn {

/// `app`: a program's, whose words are all described. `format`: "man" (roff, section 1), "bash" or "zsh" (a
/// completion). Nothing for other formats.
[[nodiscard]] std::optional<std::string> help_as(const CLI::App& app, std::string_view format);

/// What --help prints: in the form that the environment asks for (CAIRN_HELP_AS, when the project is built),
/// or for a person.
[[nodiscard]] std::string told_help(const CLI::App& app);

}  // namespace cairn
