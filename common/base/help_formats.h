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

/// The words behind the help of a program or of one of its commands. CLI11 hands those of a program down to
/// its commands: of examples, a command has those that show it, and of the rest what is not the program's.
[[nodiscard]] std::string own_footer(const CLI::App& app);

/// The help of CLI11 with that. To be set before the commands are added, which take it over.
class OwnFooter : public CLI::Formatter {
 public:
  [[nodiscard]] std::string make_footer(const CLI::App* app) const override;
};

/// What --help prints: in the form that the environment asks for (CAIRN_HELP_AS, when the project is built),
/// or for a person.
[[nodiscard]] std::string told_help(const CLI::App& app);

}  // namespace cairn
