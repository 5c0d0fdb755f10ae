// SPDX-License-Identifier: Apache-2.0
#include "common/base/unknown_word.h"

#include <gtest/gtest.h>

#include "common/base/utf8.h"

namespace cairn {
namespace {

/// What is said of a command line of a program with commands.
std::optional<std::string> said_of(const std::string& line) {
  CLI::App app("test", "program");
  std::string text;
  int number = 0;
  app.require_subcommand(1);
  app.fallthrough();
  app.add_option("--domain", number);
  CLI::App* map = app.add_subcommand("map");
  map->add_option("MAP", text)->required();
  map->require_subcommand(1);
  map->add_subcommand("rename")->add_option("NAME", text)->required();
  app.add_subcommand("status")->add_option("--source", text)->required();
  try {
    app.parse(line);
  } catch (const CLI::ParseError& error) {
    return unknown_word(app, error);
  }
  ADD_FAILURE() << line << " was parsed";
  return std::nullopt;
}

TEST(UnknownWordTest, IsNamedWithTheNearestCommandOrOption) {
  EXPECT_EQ(said_of("statsu"), "unknown argument 'statsu'; did you mean status?");
  EXPECT_EQ(said_of("map desk renmae bench"), "unknown argument 'renmae'; did you mean rename?");
  EXPECT_EQ(said_of("status --source x --domian=3"), "unknown argument '--domian=3'; did you mean --domain?");
  EXPECT_EQ(said_of("xyzzy-xyzzy"), "unknown argument 'xyzzy-xyzzy'");
}

TEST(UnknownWordTest, IsNamedRatherThanWhatIsMissing) {
  EXPECT_EQ(said_of("status --sorce x"), "unknown argument '--sorce'; did you mean --source?");
}

TEST(UnknownWordTest, NothingWhereWordsAreMissingOrOfTheWrongKind) {
  EXPECT_EQ(said_of(""), std::nullopt);
  EXPECT_EQ(said_of("status"), std::nullopt);
  EXPECT_EQ(said_of("status --source x --domain many"), std::nullopt);
  EXPECT_EQ(said_of("status --source x --domain many --"), std::nullopt);
  EXPECT_EQ(said_of("status --domain 3 -- xyzzy-xyzzy"), "unknown argument 'xyzzy-xyzzy'");
}

TEST(UnknownWordTest, NothingWhereHelpIsAskedFor) {
  EXPECT_EQ(said_of("statsu --help"), std::nullopt);
}

TEST(EndOfParse, NamesWordsOfAnyBytesSafely) {
  CLI::App app("test", "program");
  int number = 0;
  app.add_option("--domain", number);
  for (const std::string word : {"caf\xe9\x1b[2J", "--domain=\xff"}) {
    testing::internal::CaptureStderr();
    try {
      app.parse({word});
      FAIL() << "was parsed";
    } catch (const CLI::ParseError& error) {
      EXPECT_EQ(end_of_parse(app, error), 2);
    }
    const std::string said = testing::internal::GetCapturedStderr();
    EXPECT_EQ(many_lines(said), said);
    EXPECT_NE(said.find(word.front() == 'c' ? "caf\\xe9 [2J" : "\\xff"), std::string::npos) << said;
  }
}

}  // namespace
}  // namespace cairn
