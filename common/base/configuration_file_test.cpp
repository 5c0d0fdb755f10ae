// SPDX-License-Identifier: Apache-2.0
#include "common/base/configuration_file.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

namespace cairn {
namespace {

struct EngineOptions {
  double reach = 0.1;
};

class ConfigurationFile : public ::testing::Test {
 protected:
  ~ConfigurationFile() override { std::filesystem::remove(path_); }
  Result<ConfigurationWords> read(const std::string& text) {
    std::ofstream(path_) << text;
    return read_configuration(path_, {"domain", "name"}, engines_);
  }
  std::string complaint_about(const std::string& text) {
    const auto words = read(text);
    EXPECT_FALSE(words);
    return words ? "" : words.error().message.substr(path_.string().size());
  }

  std::filesystem::path path_ =
      std::filesystem::temp_directory_path() / ("cairn-configuration-" + std::to_string(getpid()) + ".yaml");
  EngineOptions engine_;
  OptionList engines_ =
      OptionList().add_part("engine", OptionList().add("reach", &engine_.reach, {0, 1}, "m"));
};

TEST_F(ConfigurationFile, WhatIsWrittenIsReadAsTheSame) {
  engine_.reach = 1.0 / 3;
  const std::string hard = "a: 'b' # \"c\" \\ ~";
  const std::string text = write_configuration(
      "cairn-x", {{"domain", "7"}, {"name", hard}, {"other", "as it comes", false}}, engines_);
  engine_.reach = 0;
  const auto words = read(text);
  ASSERT_TRUE(words) << words.error().message;
  EXPECT_EQ(*words, (ConfigurationWords{{"domain", "7"}, {"name", hard}}));
  EXPECT_EQ(engine_.reach, 1.0 / 3);
}

TEST_F(ConfigurationFile, RefusesWhatItDoesNotKnow) {
  EXPECT_EQ(complaint_about("domain: 3\ndomian: 4\n"), ":2: unknown key 'domian'; did you mean domain?");
  EXPECT_EQ(complaint_about("engin: {}\n"), ":1: unknown key 'engin'; did you mean engine?");
  EXPECT_EQ(complaint_about("engine:\n  raech: 1\n"), ":2: unknown key 'raech'; did you mean reach?");
  EXPECT_EQ(complaint_about("engine:\n  reach: 2\n"), ":2: reach is 2: expected 0 to 1 [m]");
  EXPECT_EQ(complaint_about("name: a\nname: b\n"), ":2: 'name' is there twice");
  EXPECT_EQ(complaint_about("name: [a]\n"), ":1: expected `key: value`");
  EXPECT_EQ(complaint_about("- name\n"), ": expected `key: value` lines");
  EXPECT_TRUE(read(""));
}

}  // namespace
}  // namespace cairn
