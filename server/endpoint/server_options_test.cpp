// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/server_options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "common/io/test_directory.h"
#include "common/map/limits.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;

ServerOptions accepted(const std::vector<std::string>& arguments) {
  const auto parsed = parse_server_options(arguments);
  if (const auto* exit = std::get_if<EarlyExit>(&parsed)) {
    ADD_FAILURE() << exit->text;
    return {};
  }
  return std::get<ServerOptions>(parsed);
}

EarlyExit refused(const std::vector<std::string>& arguments) {
  const auto parsed = parse_server_options(arguments);
  if (const auto* exit = std::get_if<EarlyExit>(&parsed)) return *exit;
  ADD_FAILURE() << "was taken";
  return {};
}

class ServerOptionsTest : public ::testing::Test {
 protected:
  std::string configuration(const std::string& text) {
    std::ofstream(path_) << text;
    return path_;
  }
  TestDirectory directory_;
  std::string path_ = directory_.path() / "cairn-server-options.yaml";
};

TEST_F(ServerOptionsTest, TheStatisticsAreNoFileThatIsRead) {
  const std::string file = configuration("domain: 3\n");
  for (const char* role : {"--config", "--wearers"}) {
    const EarlyExit exit = refused({role, file, "--stats", file});
    EXPECT_EQ(exit.code, 2);
    EXPECT_THAT(exit.text, HasSubstr(role));
  }
  (void)accepted({"--config", file, "--stats", file + ".json"});
}

TEST_F(ServerOptionsTest, TheFileIsReadAsOtherMachinesWriteText) {
  EXPECT_EQ(accepted({"--config", configuration("\xef\xbb\xbf"
                                                "domain: 7\r\nseed: 3\r\n")})
                .domain,
            7);
  EXPECT_EQ(accepted({"--config", configuration("seed: 3\rdomain: 8\r")}).domain, 8);
  const EarlyExit wide = refused({"--config", configuration(std::string("\xff\xfe\x61\0", 4))});
  EXPECT_EQ(wide.code, 3);
  EXPECT_THAT(wide.text, HasSubstr("is UTF-16 text"));
  EXPECT_EQ(refused({"--config", directory_.path()}).code, 3);
}

TEST_F(ServerOptionsTest, DefaultsServeThisMachine) {
  const ServerOptions options = accepted({});
  EXPECT_EQ(options.domain, 0);
  EXPECT_EQ(options.profile, "loopback");
  EXPECT_EQ(options.seed, 0U);
  EXPECT_EQ(options.max_maps, 1000U);
  EXPECT_EQ(options.max_maps_per_client, 200U);
  EXPECT_GT(options.max_memory_mb, 0U);
}

TEST_F(ServerOptionsTest, LimitsAreNumbersFromOne) {
  const ServerOptions options = accepted({"--max-maps", "3", "--max-memory=512", "--stats", "server.json"});
  EXPECT_EQ(options.stats, "server.json");
  const ServerOptions limited = accepted({"--max-maps-per-client=7", "--max-keyframes=50", "--max-labels=20",
                                          "--keyframe-rate=0.5", "--query-rate=0"});
  EXPECT_EQ(limited.max_maps_per_client, 7U);
  EXPECT_EQ(limited.max_keyframes, 50U);
  EXPECT_EQ(limited.max_labels, 20U);
  EXPECT_EQ(limited.rates.keyframes, 0.5);
  EXPECT_EQ(limited.rates.queries, 0);
  EXPECT_EQ(refused({"--max-labels", "1001"}).code, 2);
  EXPECT_EQ(accepted({"--max-keyframes", std::to_string(kMaxKeyframes)}).max_keyframes, kMaxKeyframes);
  EXPECT_EQ(refused({"--max-keyframes", std::to_string(kMaxKeyframes + 1)}).code, 2)
      << "more than a map takes";
  for (const char* rate : {"-1", "nan", "inf", "many", "1/s"})
    EXPECT_EQ(refused({"--keyframe-rate", rate}).code, 2) << rate;
  EXPECT_EQ(options.max_maps, 3U);
  EXPECT_EQ(options.max_memory_mb, 512U);
  for (const char* none : {"0", "-1", "many"}) {
    EXPECT_EQ(refused({"--max-maps", none}).code, 2);
    EXPECT_EQ(refused({"--max-maps-per-client", none}).code, 2);
    EXPECT_EQ(refused({"--max-keyframes", none}).code, 2);
    EXPECT_EQ(refused({"--max-labels", none}).code, 2);
    EXPECT_EQ(refused({"--max-memory", none}).code, 2);
  }
}

TEST_F(ServerOptionsTest, OlderNamesOfOptionsStillGoButNotBesideTheNewOnes) {
  EXPECT_EQ(accepted({"--rest-after", "5"}).idle_after, std::chrono::seconds(5));
  const auto path = directory_.path() / "older.yaml";
  std::ofstream(path) << "question-rate: 3\nrest-after: 7\n";
  const ServerOptions options = accepted({"--config", path, "--idle-after", "9"});
  EXPECT_EQ(options.rates.queries, 3);
  EXPECT_EQ(options.idle_after, std::chrono::seconds(9)) << "the line wins";
  std::ofstream(path, std::ios::app) << "idle-after: 8\n";
  const EarlyExit both = refused({"--config", path});
  EXPECT_EQ(both.code, 3);
  EXPECT_THAT(both.text, HasSubstr("idle-after and rest-after are one option"));
}

TEST_F(ServerOptionsTest, MapsAreIdleAfterAMinuteUnlessToldOtherwise) {
  EXPECT_EQ(accepted({}).idle_after, std::chrono::seconds(60));
  EXPECT_EQ(accepted({"--idle-after", "5"}).idle_after, std::chrono::seconds(5));
  EXPECT_EQ(accepted({"--idle-after=0"}).idle_after, std::chrono::seconds(0));
  for (const char* none : {"-1", "soon", "5000000000"}) EXPECT_EQ(refused({"--idle-after", none}).code, 2);
  EXPECT_EQ(accepted({}).drop_after, std::chrono::seconds(10));
  EXPECT_EQ(accepted({"--drop-after", "0"}).drop_after, std::chrono::seconds(0));
  for (const char* none : {"-1", "soon"}) EXPECT_EQ(refused({"--drop-after", none}).code, 2);
  EXPECT_EQ(accepted({}).keep_deleted, std::chrono::hours(0));
  EXPECT_EQ(accepted({"--keep-deleted", "30"}).keep_deleted, std::chrono::hours(720));
  for (const char* none : {"-1", "soon"}) EXPECT_EQ(refused({"--keep-deleted", none}).code, 2);
}

TEST_F(ServerOptionsTest, LockstepIsForOneMachineUnlessToldOtherwise) {
  EXPECT_TRUE(accepted({}).lockstep);
  EXPECT_FALSE(accepted({"--profile", "wifi"}).lockstep);
  EXPECT_FALSE(accepted({"--profile", "mine.xml"}).lockstep);
  EXPECT_TRUE(accepted({"--profile", "wifi", "--lockstep", "allow"}).lockstep);
  EXPECT_FALSE(accepted({"--lockstep=refuse"}).lockstep);
  EXPECT_FALSE(accepted({"--listen", "eth0"}).lockstep);
  EXPECT_TRUE(accepted({"--listen", "127.0.0.1"}).lockstep);
  const auto path = configuration("profile: wifi\n");
  EXPECT_FALSE(accepted({"--config", path}).lockstep);
  EXPECT_TRUE(accepted({"--config", path, "--profile", "loopback"}).lockstep);
  EXPECT_THAT(refused({"--lockstep", "yes"}).text, HasSubstr("allow or refuse"));
}

TEST_F(ServerOptionsTest, TheRuleForWearersIsChosen) {
  EXPECT_EQ(accepted({}).wearer_policy, WearerPolicy::kFirst);
  const ServerOptions options = accepted({"--wearer-rule", "only", "--wearers", "who.yaml"});
  EXPECT_EQ(options.wearer_policy, WearerPolicy::kOnly);
  EXPECT_EQ(options.wearers, "who.yaml");
  EXPECT_THAT(refused({"--wearer-rule", "none"}).text, HasSubstr("first or only"));
}

TEST_F(ServerOptionsTest, TheRelocalizerIsChosen) {
  EXPECT_EQ(accepted({}).relocalization.method, RelocMethod::kImproved);
  EXPECT_EQ(accepted({"--relocalizer", "paper"}).relocalization.method, RelocMethod::kPaper);
  const auto path = configuration("relocalizer: paper\n");
  EXPECT_EQ(accepted({"--config", path}).relocalization.method, RelocMethod::kPaper);
  EXPECT_EQ(accepted({"--config", path, "--relocalizer=improved"}).relocalization.method,
            RelocMethod::kImproved);
  EXPECT_THAT(refused({"--relocalizer", "2008"}).text, HasSubstr("improved or paper"));
}

TEST_F(ServerOptionsTest, TheCommandLineWinsOverTheFile) {
  const auto path = configuration("domain: 7\nprofile: wifi\nseed: 12345678901234567890\n");
  const ServerOptions options = accepted({"--config", path, "--domain=9", "-v"});
  EXPECT_EQ(options.domain, 9);
  EXPECT_EQ(options.profile, "wifi");
  EXPECT_EQ(options.seed, 12345678901234567890U);
  EXPECT_EQ(options.verbosity, 1);
}

TEST_F(ServerOptionsTest, MistakesOnTheCommandLineNameTheRemedy) {
  EXPECT_EQ(refused({"--domian", "3"}).code, 2);
  EXPECT_THAT(refused({"--domian", "3"}).text, HasSubstr("did you mean --domain?"));
  EXPECT_EQ(refused({"--domain", "231"}).code, 2);
  EXPECT_THAT(refused({"--domain", "many"}).text, HasSubstr("0 to 230"));
  EXPECT_THAT(refused({"--seed", "-1"}).text, HasSubstr("seed"));
  EXPECT_EQ(refused({"--profile"}).code, 2);
}

TEST_F(ServerOptionsTest, MistakesInTheFileNameLineAndRemedy) {
  const EarlyExit unknown = refused({"--config", configuration("domain: 1\nprofil: wifi\n")});
  EXPECT_EQ(unknown.code, 3);
  EXPECT_THAT(unknown.text, HasSubstr(":2: unknown key 'profil'; did you mean profile?"));
  EXPECT_EQ(refused({"--config", configuration("domain: x\n")}).code, 3);
  EXPECT_EQ(refused({"--config", configuration("domain: not available yet\n")}).code, 3);
  EXPECT_EQ(refused({"--config", configuration("domain: [1]\n")}).code, 3);
  EXPECT_EQ(refused({"--config", configuration("- domain\n")}).code, 3);
  EXPECT_EQ(refused({"--config", configuration("domain: {\n")}).code, 3);
  EXPECT_EQ(refused({"--config", configuration("seed: 1\nseed: 2\n")}).code, 3);
  EXPECT_EQ(refused({"--config", path_ + ".missing"}).code, 3);
  EXPECT_EQ(accepted({"--config", configuration("")}).domain, 0);
}

TEST_F(ServerOptionsTest, WhatPrintConfigTellsIsReadAsTheSame) {
  const std::string constants = configuration(
      "relocalization:\n  same_pose: 0.123456789\n  confirm:\n    by_few: {evidence: 0.7}\nmap_maker: "
      "{baseline: 0.25}\n");
  const std::vector<std::vector<std::string>> lines = {
      {},
      {"--domain=9", "--seed", "12345678901234567890", "--lockstep=refuse", "--store", "a b#c",
       "--max-memory=7", "--relocalizer", "paper", "--adjuster", "ceres", "--keyframe-rate", "0.1",
       "--keep-deleted", "3"},
      {"--config", constants, "--profile", "wifi"}};
  for (auto line : lines) {
    line.emplace_back("--print-config");
    const EarlyExit printed = refused(line);
    ASSERT_EQ(printed.code, 0) << printed.text;
    EXPECT_THAT(printed.text, HasSubstr("by_few:")) << "the constants, too";
    EXPECT_EQ(refused({"--config", configuration(printed.text), "--print-config"}).text, printed.text);
  }
}

TEST_F(ServerOptionsTest, WhatPrintConfigTellsPinsNothingThatDependsOnTheProfileOrTheMachine) {
  const EarlyExit printed = refused({"--print-config"});
  EXPECT_THAT(printed.text, HasSubstr("\n# lockstep: allow\n"));
  EXPECT_THAT(printed.text, HasSubstr("\n# max-memory: "));
  const auto path = configuration(printed.text);
  EXPECT_TRUE(accepted({"--config", path}).lockstep);
  EXPECT_FALSE(accepted({"--config", path, "--profile", "wifi"}).lockstep);
  const EarlyExit given = refused({"--lockstep=allow", "--max-memory=7", "--print-config"});
  const auto pinned = configuration(given.text);
  EXPECT_TRUE(accepted({"--config", pinned, "--profile", "wifi"}).lockstep);
  EXPECT_EQ(accepted({"--config", pinned}).max_memory_mb, 7U);
}

TEST_F(ServerOptionsTest, AFileSetsConstantsOfTheEngines) {
  const auto path = configuration(
      "relocalization:\n  confirm:\n    by_few: {evidence: 0.7}\nmap_maker:\n  max_points_per_keyframe: "
      "500\n");
  const ServerOptions options = accepted({"--config", path});
  EXPECT_EQ(options.relocalization.confirm.by_few.evidence, 0.7);
  EXPECT_EQ(options.relocalization.confirm.by_few.similarity, ConfirmOptions().by_few.similarity);
  EXPECT_EQ(options.mapping.max_points_per_keyframe, 500);
  EXPECT_THAT(refused({"--config", configuration("relocalization:\n  confirm: {by_fwe: {}}\n")}).text,
              HasSubstr(":2: unknown key 'by_fwe'; did you mean by_few?"));
  const EarlyExit beyond = refused({"--config", configuration("relocalization:\n  shortlist: 0\n")});
  EXPECT_EQ(beyond.code, 3);
  EXPECT_THAT(beyond.text, HasSubstr("shortlist is 0: expected 1 to"));
}

TEST_F(ServerOptionsTest, EnginesHaveDefaultsInTheirRanges) {
  EXPECT_TRUE(check_options(MapMakerOptions()));
  EXPECT_TRUE(check_options(RelocOptions()));
}

TEST_F(ServerOptionsTest, WhatIsNotThereYetIsRefusedOnlyWhenUsed) {
  for (const std::string name : {"http"}) {
    const EarlyExit exit = refused({"--" + name, "x"});
    EXPECT_EQ(exit.code, 2);
    EXPECT_THAT(exit.text, HasSubstr("--" + name));
    EXPECT_THAT(exit.text, HasSubstr("not available yet"));
    EXPECT_EQ(refused({"--config", configuration(name + ": x\n")}).code, 2);
  }
}

TEST_F(ServerOptionsTest, HelpHasExamplesAndEveryOptionOfTheContract) {
  const EarlyExit help = refused({"--help"});
  EXPECT_EQ(help.code, 0);
  for (const char* word : {"Examples:",    "--config",        "--store",        "--domain",
                           "--listen",     "--profile",       "--security",     "--http",
                           "--seed",       "--max-maps",      "--max-memory",   "--max-keyframes",
                           "--max-labels", "--keyframe-rate", "--query-rate",   "--relocalizer",
                           "--idle-after", "--drop-after",    "--keep-deleted", "--wearer-rule",
                           "--wearers",    "--stats",         "--lockstep",     "--max-maps-per-client"}) {
    EXPECT_THAT(help.text, HasSubstr(word));
  }
  EXPECT_EQ(refused({"--version"}).code, 0);
}

}  // namespace
}  // namespace cairn
