// SPDX-License-Identifier: Apache-2.0
#include "common/base/help_formats.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <memory>

namespace cairn {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

class HelpFormats : public ::testing::Test {
 protected:
  HelpFormats() : app_("It's a test.", "cairn-test") {
    app_.add_option("--server", text_, "host")->capture_default_str();
    CLI::App* map = app_.add_subcommand("map", "one map");
    map->add_option("MAP", text_, "its name")->required();
    map->add_subcommand("rename", "calls it otherwise: now");
    map->add_subcommand("show", "all of it")->add_flag("--all", flag_, "what's hidden, too");
    app_.add_subcommand("status", ".how it is");
    app_.footer("Examples:\n  cairn-test map desk show");
  }
  /// What bash offers behind a line, one word each.
  [[nodiscard]] std::string offered(const std::string& line) const {
    const std::string script = *help_as(app_, "bash") + "\nCOMP_WORDS=(" + line +
                               " ''); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); "
                               "_cairn_test; echo \"${COMPREPLY[*]}\"";
    std::string quoted = "bash -c '";
    for (const char c : script) quoted += c == '\'' ? "'\\''" : std::string(1, c);
    const std::unique_ptr<FILE, int (*)(FILE*)> pipe(popen((quoted + "' 2>&1").c_str(), "r"), &pclose);
    std::string said;
    std::array<char, 4096> piece{};
    while (pipe != nullptr && std::fgets(piece.data(), piece.size(), pipe.get()) != nullptr)
      said += piece.data();
    return " " + said;
  }

  CLI::App app_;
  std::string text_ = "localhost";
  bool flag_ = false;
};

TEST_F(HelpFormats, TheCompletionFollowsTheLineAndPassesOverNames) {
  EXPECT_THAT(offered("cairn-test"), HasSubstr(" map status "));
  EXPECT_THAT(offered("cairn-test"), HasSubstr(" --server"));
  const std::string below = offered("cairn-test --server host map desk");
  EXPECT_THAT(below, HasSubstr(" rename show "));
  EXPECT_THAT(below, Not(HasSubstr(" status")));
  EXPECT_THAT(offered("cairn-test map desk show"), HasSubstr(" --all"));
}

TEST_F(HelpFormats, ZshIsToldWhatEachWordMeans) {
  const std::string made = *help_as(app_, "zsh");
  EXPECT_THAT(made, HasSubstr("#compdef cairn-test\n"));
  EXPECT_THAT(made, HasSubstr("'rename:calls it otherwise: now'"));
  EXPECT_THAT(made, HasSubstr("'--all:what'\\''s hidden, too'"));
  EXPECT_THAT(made, HasSubstr("(/map|/map/rename|/map/show|/status)"));
}

TEST_F(HelpFormats, ACommandShowsItsOwnExamplesAndNotThoseOfOthers) {
  CLI::App app("A test.", "cairn-test");
  app.formatter(std::make_shared<OwnFooter>());
  app.footer("Exit codes: 0\n\nExamples:\n  cairn-test map desk show    shows a map\n  cairn-test status");
  CLI::App* map = app.add_subcommand("map", "one map");
  const CLI::App* show = map->add_subcommand("show", "all of it");
  const CLI::App* shows = app.add_subcommand("shows", "only a word in what an example does");
  const CLI::App* list = app.add_subcommand("list", "is in no example");
  map->footer("A map is a map.\n\nExamples:\n  cairn-test map desk rename bench\n      and back");
  const CLI::App* rename = map->add_subcommand("rename", "calls it otherwise");
  EXPECT_THAT(app.help(), HasSubstr("  cairn-test status\n"));
  EXPECT_THAT(app.help(), HasSubstr("Exit codes: 0\n"));
  EXPECT_EQ(own_footer(*show), "Examples:\n  cairn-test map desk show    shows a map");
  EXPECT_EQ(own_footer(*rename),
            "A map is a map.\n\nExamples:\n  cairn-test map desk rename bench\n      and back");
  EXPECT_THAT(show->help(), Not(HasSubstr("status")));
  for (const CLI::App* without : {shows, list}) EXPECT_THAT(without->help(), Not(HasSubstr("Example")));
  EXPECT_THAT(*help_as(app, "man"), Not(HasSubstr("list\nis in no example\n.PP")));
}

TEST_F(HelpFormats, ThePageHasEveryWordAndNothingInItIsARequest) {
  const std::string page = *help_as(app_, "man");
  EXPECT_THAT(page, HasSubstr(".TH CAIRN\\-TEST 1\n"));
  EXPECT_THAT(page, HasSubstr(".SS cairn\\-test map rename\ncalls it otherwise: now\n"));
  EXPECT_THAT(page, HasSubstr("\\fB\\-\\-server TEXT\\fR"));
  EXPECT_THAT(page, HasSubstr("\n\\&.how it is\n"));
  EXPECT_THAT(page, HasSubstr("cairn\\-test map desk show"));
  EXPECT_FALSE(help_as(app_, "html"));
}

}  // namespace
}  // namespace cairn
