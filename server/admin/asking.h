// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>

#include "common/base/result.h"
#include "server/admin/admin_client.h"

/// Most commands of cairnctl: they ask the server, and print its answer.
namespace cairn {

/// The action that the words of a line ask for; empty, unless they were there. `as_json`: answers are printed
/// for machines.
using AccessAction = std::function<Status(AdminClient* client, bool as_json)>;

/// Asks, and prints the answer as JSON or by `print`.
[[nodiscard]] Status ask_and_print(AdminClient* client, const nlohmann::json& request, bool as_json,
                                   const std::function<void(const nlohmann::json&)>& print);

/// Whether a question was answered with yes, by a person at a terminal. Error kUsage without a terminal: it
/// names the option that says yes.
[[nodiscard]] Result<bool> confirmed(const std::string& question);
/// Asks the person a question, unless `yes`. Errors: kRefused (it was not confirmed), those of confirmed().
[[nodiscard]] Status confirm(bool yes, const std::string& question);
/// The flag for `yes`.
void add_yes(CLI::App* app, bool* yes);

/// Says what is wrong with a word that goes to the server as text (UTF-8; a path may be any bytes); empty:
/// nothing.
[[nodiscard]] std::string fault_of_word(const std::string& text);

}  // namespace cairn
