// SPDX-License-Identifier: Apache-2.0
#include "server/admin/asking.h"

#include <unistd.h>

#include <cstdio>
#include <iostream>

#include "common/base/utf8.h"
#include "common/io/json_text.h"
#include "common/io/text.h"

namespace cairn {

using nlohmann::json;

Status ask_and_print(AdminClient* client, const json& request, bool as_json,
                     const std::function<void(const json&)>& print) {
  const auto answer = client->ask(request);
  if (!answer) return tl::unexpected(answer.error());
  if (as_json) {
    std::printf("%s\n", json_text(answer->content, 2).c_str());
  } else {
    print(answer->content);
  }
  return {};
}

Result<bool> confirmed(const std::string& question) {
  if (isatty(STDIN_FILENO) == 0)
    return fail(ErrorCode::kUsage, question +
                                       " Nobody can answer: standard input is no terminal. If it is meant, "
                                       "give the command with --yes");
  std::fprintf(stderr, "%s [y/N] ", one_line(question).c_str());
  std::string answer;
  std::getline(std::cin, answer);
  return answer == "y" || answer == "yes";
}

Status confirm(bool yes, const std::string& question) {
  if (yes) return {};
  const auto said = confirmed(question);
  if (!said) return tl::unexpected(said.error());
  return *said ? Status() : fail(ErrorCode::kRefused, "nothing was done");
}

void add_yes(CLI::App* app, bool* yes) {
  app->add_flag("--yes", *yes, "does not ask whether it is meant");
}

std::string fault_of_word(const std::string& text) {
  const auto fault = fault_of_text(text);
  return fault ? in_quotes(text) + ": " + *fault : std::string();
}

}  // namespace cairn
