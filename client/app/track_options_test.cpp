// SPDX-License-Identifier: Apache-2.0
#include "client/app/track_options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "common/map/ids.h"

namespace cairn {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

auto parse(std::vector<std::string> arguments) {
  return parse_track_options(std::move(arguments), "host", 42);
}

TrackOptions good(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), {"--source", "sim:desk"});
  auto parsed = parse(std::move(arguments));
  if (const auto* exit = std::get_if<ParseExit>(&parsed)) ADD_FAILURE() << exit->text;
  return std::holds_alternative<TrackOptions>(parsed) ? std::get<TrackOptions>(parsed) : TrackOptions{};
}

/// Exit code 2, and the message.
std::string wrong(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), {"--source", "sim:desk"});
  auto parsed = parse(std::move(arguments));
  if (!std::holds_alternative<ParseExit>(parsed)) {
    ADD_FAILURE() << "accepted";
    return {};
  }
  EXPECT_EQ(std::get<ParseExit>(parsed).code, 2);
  return std::get<ParseExit>(parsed).text;
}

TEST(TrackOptions, DefaultsAreThoseOfTheContract) {
  const auto options = good({});
  EXPECT_EQ(options.source, "sim:desk");
  EXPECT_EQ(options.server, "localhost");
  EXPECT_EQ(options.domain, 0);
  EXPECT_EQ(options.profile, "");
  EXPECT_EQ(options.name, "host-42");
  EXPECT_EQ(options.pace, Pace::kRealtime);
  EXPECT_FALSE(options.reader);
  EXPECT_TRUE(options.proposes);
  EXPECT_TRUE(options.makes_maps());
  EXPECT_FALSE(options.calibration);
  EXPECT_FALSE(options.trajectory || options.stats || options.video);
}

TEST(TrackOptions, ARigIsCommandedInRealTime) {
  EXPECT_EQ(good({}).rig, "");
  const auto options = good({"--rig", "shoulder", "--rig-mode", "fixate", "--fixate", "kettle"});
  EXPECT_EQ(options.rig, "shoulder");
  EXPECT_EQ(options.rig_aim, RigAim::kFixate);
  EXPECT_EQ(options.fixated_label, "kettle");
  EXPECT_EQ(good({"--rig", "shoulder"}).rig_aim, RigAim::kFollow);
  EXPECT_EQ(good({"--rig", "shoulder"}).rig_search, wire::RigSearchPattern::kSpiral);
  EXPECT_EQ(good({"--rig", "shoulder", "--rig-search", "raster"}).rig_search,
            wire::RigSearchPattern::kRaster);
  EXPECT_THAT(wrong({"--rig", "shoulder", "--rig-search", "zigzag"}), HasSubstr("zigzag"));
  EXPECT_THAT(wrong({"--rig", "shoulder", "--pace", "lockstep"}), HasSubstr("realtime"));
  EXPECT_THAT(wrong({"--rig", "Shoulder!"}), HasSubstr("Shoulder!"));
  EXPECT_THAT(wrong({"--rig-mode", "lock"}), HasSubstr("--rig-mode: only with --rig"));
  EXPECT_THAT(wrong({"--rig-mode", "follow"}), HasSubstr("--rig-mode: only with --rig"));
  EXPECT_THAT(wrong({"--fixate", "kettle"}), HasSubstr("--fixate: only with --rig"));
  EXPECT_THAT(wrong({"--rig", "shoulder", "--fixate", "kettle"}), HasSubstr("--rig-mode fixate"));
  EXPECT_THAT(wrong({"--rig", "shoulder", "--imu", "imu.csv"}), HasSubstr("--rig and --imu"));
  EXPECT_THAT(wrong({"--rig", "shoulder", "--imu-mount", "0,0,0,1"}), HasSubstr("--rig and --imu"));
  EXPECT_THAT(wrong({"--rig", "shoulder", "--imu-time-offset", "0"}), HasSubstr("--rig and --imu"));
  EXPECT_THAT(wrong({"--rig", "shoulder", "--rig-mode", "dance"}), HasSubstr("dance"));
}

TEST(TrackOptions, LabelsArePlacedByABuilderWithoutAWindow) {
  EXPECT_EQ(good({"--headless", "--labels", "l.txt"}).labels, "l.txt");
  EXPECT_FALSE(good({"--headless"}).labels);
  EXPECT_THAT(wrong({"--labels", "l.txt"}), HasSubstr("--headless"));
  EXPECT_THAT(wrong({"--headless", "--role", "reader", "--labels", "l.txt"}), HasSubstr("reader"));
}

TEST(TrackOptions, EveryOptionOfTheContractIsTaken) {
  const auto options =
      good({"--calibration", "c.txt",    "--server",  "desk.local", "--listen",       "wlan0",
            "--domain",      "7",        "--profile", "wifi",       "--name",         "cam-1",
            "--wearer",      "anna",     "--role",    "reader",     "--no-proposals", "--no-new-maps",
            "--pace",        "lockstep", "--seed",    "99",         "--headless",     "--trajectory",
            "t.txt",         "--stats",  "s.json",    "--video",    "v.mp4",          "-v"});
  EXPECT_EQ(options.calibration, "c.txt");
  EXPECT_EQ(options.server, "desk.local");
  EXPECT_EQ(options.listen, "wlan0");
  EXPECT_EQ(options.domain, 7);
  EXPECT_EQ(options.profile, "wifi");
  EXPECT_EQ(options.name, "cam-1");
  EXPECT_EQ(options.wearer, "anna");
  EXPECT_TRUE(options.reader);
  EXPECT_FALSE(options.proposes);
  EXPECT_TRUE(options.no_new_maps);
  EXPECT_FALSE(options.makes_maps());
  EXPECT_EQ(options.pace, Pace::kLockstep);
  EXPECT_EQ(options.seed, 99U);
  EXPECT_TRUE(options.headless);
  EXPECT_EQ(options.trajectory, "t.txt");
  EXPECT_EQ(options.stats, "s.json");
  EXPECT_EQ(options.video, "v.mp4");
  EXPECT_EQ(options.verbosity, 1);
}

TEST(TrackOptions, AnImuIsNamedWithHowItSits) {
  const auto options = good({"--imu", "imu.csv", "--imu-mount", "0,0,0,1", "--imu-time-offset", "-0.0125"});
  EXPECT_EQ(options.imu.samples, "imu.csv");
  EXPECT_EQ(options.imu.mount, "0,0,0,1");
  EXPECT_EQ(options.imu.clock_offset, std::chrono::nanoseconds(-12'500'000));
  EXPECT_FALSE(good({}).imu.samples || good({}).imu.clock_offset);
  EXPECT_THAT(wrong({"--imu-time-offset", "soon"}), HasSubstr("--imu-time-offset"));
}

TEST(TrackOptions, AnUnknownOptionNamesTheNearestOne) {
  EXPECT_THAT(wrong({"--pcae", "max"}), HasSubstr("--pace"));
  EXPECT_THAT(wrong({"--trajektory=t.txt"}), HasSubstr("--trajectory"));
  EXPECT_THAT(wrong({"--xyzzy"}), Not(HasSubstr("did you mean")));
}

TEST(TrackOptions, AWrongValueNamesTheValidOnes) {
  const auto pace = wrong({"--pace", "slow"});
  EXPECT_THAT(pace, HasSubstr("realtime"));
  EXPECT_THAT(pace, HasSubstr("lockstep"));
  EXPECT_THAT(pace, HasSubstr("max"));
  EXPECT_THAT(wrong({"--role", "king"}), HasSubstr("builder"));
  EXPECT_THAT(wrong({"--domain", "231"}), HasSubstr("230"));
  EXPECT_THAT(wrong({"--name", "Desk 1"}), HasSubstr("a-z"));
  EXPECT_THAT(wrong({"--wearer", "Anna B."}), HasSubstr("a-z"));
  EXPECT_THAT(wrong({"--seed", "-1"}), HasSubstr("--seed"));
  EXPECT_THAT(wrong({"--seed", "18446744073709551616"}), HasSubstr("--seed")) << "overflow";
  EXPECT_THAT(wrong({"--map", "desk"}), HasSubstr("--map")) << "a builder's map is its own";
  EXPECT_THAT(wrong({"--role", "reader", "--lost-patience", "5"}), HasSubstr("only a builder begins a map"));
  EXPECT_THAT(wrong({"--no-new-maps", "--lost-patience", "1"}), HasSubstr("only a builder begins a map"));
}

/// A file of settings, gone with it.
class SettingsFile {
 public:
  explicit SettingsFile(const std::string& text) { std::ofstream(path_) << text; }
  ~SettingsFile() { std::filesystem::remove(path_); }
  [[nodiscard]] std::string path() const { return path_.string(); }

 private:
  static inline int count_ = 0;
  std::filesystem::path path_ =
      std::filesystem::temp_directory_path() /
      ("cairn-track-" + std::to_string(getpid()) + "-" + std::to_string(count_++) + ".yaml");
};

std::string printed(std::vector<std::string> arguments) {
  arguments.emplace_back("--print-config");
  const auto parsed = parse(std::move(arguments));
  const auto* exit = std::get_if<ParseExit>(&parsed);
  EXPECT_TRUE(exit != nullptr && exit->code == 0);
  return exit == nullptr ? "" : exit->text;
}

TEST(TrackOptions, WhatPrintConfigTellsIsReadAsTheSame) {
  const SettingsFile constants(
      "tracker:\n  motion:\n    decay: 0.123456789\n  finder:\n    fine_radius: 9.5\n");
  const std::vector<std::vector<std::string>> lines = {
      {},
      {"--source", "tum:a b#c", "--name", "cam-1", "--no-proposals", "--no-new-maps", "--seed", "99", "-v"},
      {"--config", constants.path(), "--source", "sim:desk", "--imu-time-offset", "-0.0125", "--imu",
       "x: y"}};
  for (const auto& line : lines) {
    const std::string text = printed(line);
    EXPECT_THAT(text, HasSubstr("tracker:")) << "the constants, too";
    const SettingsFile file(text);
    EXPECT_EQ(printed({"--config", file.path()}), text);
  }
}

/// What holds where an option is not given stands there as a comment, in the words of --help.
TEST(TrackOptions, PrintConfigTellsDefaultsThatDependOnOtherOptions) {
  const std::string text = printed({});
  EXPECT_THAT(text, HasSubstr("\n# rig-mode: follow\n"));
  EXPECT_THAT(text, HasSubstr("\n# rig-search: spiral\n"));
  EXPECT_THAT(text, HasSubstr(fmt::format("\n# lost-patience: {}\n", TrackOptions().lost_patience)));
  EXPECT_THAT(text, HasSubstr("\n# profile: loopback for localhost, wifi otherwise\n"));
  EXPECT_THAT(text, HasSubstr("\n# trajectory: not given\n"));
  const std::string off = printed({"--headless=false", "--no-proposals=false"});
  EXPECT_THAT(off, HasSubstr("\nheadless: false\n"));
  EXPECT_THAT(off, HasSubstr("\nno-proposals: false\n"));
  EXPECT_THAT(printed({"--no-proposals"}), HasSubstr("\nno-proposals: true\n"));
}

TEST(TrackOptions, PrintConfigPrintsNothingThatIsRefused) {
  EXPECT_THAT(wrong({"--print-config", "--rig-mode", "lock"}), HasSubstr("--rig-mode: only with --rig"));
  EXPECT_THAT(wrong({"--print-config", "--map", "desk"}), HasSubstr("--map: only with"));
}

TEST(TrackOptions, AFileSaysWhatTheCommandLineDoesNot) {
  const SettingsFile file(
      "source: tum:here\ndomain: 7\nheadless: true\nno-new-maps: false\npace: max\ntracker:\n  trails: "
      "{count: 70}\ncommander: {anew: 1500}\n");
  const auto options = good({"--config", file.path(), "--domain", "8"});
  EXPECT_EQ(options.source, "sim:desk");
  EXPECT_EQ(options.domain, 8);
  EXPECT_TRUE(options.headless);
  EXPECT_FALSE(options.no_new_maps);
  EXPECT_EQ(options.pace, Pace::kMax);
  EXPECT_EQ(options.tracker.trails.count, 70);
  EXPECT_EQ(options.commander.anew, std::chrono::milliseconds(1500));
  const auto alone = parse({"--config", file.path()});
  ASSERT_TRUE(std::holds_alternative<TrackOptions>(alone));
  EXPECT_EQ(std::get<TrackOptions>(alone).source, "tum:here");
}

TEST(TrackOptions, WhatIsWrongWithAFileIsTheFilesFault) {
  const auto complaint = [](const std::string& text) {
    const SettingsFile file(text);
    const auto parsed = parse({"--source", "sim:desk", "--config", file.path()});
    const auto* exit = std::get_if<ParseExit>(&parsed);
    EXPECT_TRUE(exit != nullptr && exit->code == 3) << text;
    return exit == nullptr ? "" : exit->text;
  };
  EXPECT_THAT(complaint("domian: 7\n"), HasSubstr("did you mean domain?"));
  EXPECT_THAT(complaint("domain: 777\n"), HasSubstr("230"));
  EXPECT_THAT(complaint("headless: perhaps\n"), HasSubstr("true or false"));
  EXPECT_THAT(complaint("listen: ''\n"), HasSubstr("needs a value"));
  EXPECT_THAT(complaint("config: other.yaml\n"), HasSubstr("unknown key"));
  EXPECT_THAT(complaint("tracker:\n  motion:\n    decya: 1\n"),
              HasSubstr(":3: unknown key 'decya'; did you mean decay?"));
  EXPECT_THAT(complaint("tracker:\n  motion:\n    decay: 2\n"), HasSubstr("decay is 2: expected 0 to 1"));
  const auto parsed = parse({"--source", "sim:desk", "--config", "nowhere.yaml"});
  ASSERT_TRUE(std::holds_alternative<ParseExit>(parsed));
  EXPECT_EQ(std::get<ParseExit>(parsed).code, 3);
}

TEST(TrackOptions, WhatDoesNotGoTogetherIsToldAsTheFaultOfTheLineTheFileOrBoth) {
  const SettingsFile reader("role: reader\n");
  const SettingsFile map("map: desk\n");
  const auto told = [](const SettingsFile& file, std::vector<std::string> arguments, int code) {
    arguments.insert(arguments.end(), {"--source", "sim:desk", "--config", file.path()});
    const auto parsed = parse(std::move(arguments));
    const auto* exit = std::get_if<ParseExit>(&parsed);
    EXPECT_TRUE(exit != nullptr && exit->code == code);
    return exit == nullptr ? "" : exit->text;
  };
  EXPECT_THAT(told(reader, {"--calibration", "auto"}, 2),
              AllOf(HasSubstr("--calibration auto: a reader"),
                    HasSubstr("the command line and " + reader.path() + " do not go together")));
  EXPECT_THAT(told(reader, {"--rig-mode", "lock"}, 2),
              AllOf(HasSubstr("--rig-mode: only"), Not(HasSubstr(reader.path()))));
  EXPECT_THAT(told(map, {}, 3), HasSubstr(map.path() + ": --map: only with"));
  EXPECT_TRUE(std::holds_alternative<TrackOptions>(
      parse({"--source", "sim:desk", "--config", map.path(), "--no-new-maps"})));
}

TEST(TrackOptions, KeysThatAreNotThereAreRefusedWithTheRemedy) {
  const auto parsed = parse({"--source", "sim:desk", "--security", "nowhere"});
  const auto* exit = std::get_if<ParseExit>(&parsed);
  ASSERT_NE(exit, nullptr);
  EXPECT_EQ(exit->code, 3);
  EXPECT_THAT(exit->text, HasSubstr("/nowhere/identity_ca.cert.pem"));
  EXPECT_THAT(exit->text, HasSubstr("`cairnctl keys issue`"));
}

TEST(TrackOptions, ACameraIsCalibratedFromNothingOrFromARoughFile) {
  const auto from_nothing = good({"--calibration", "auto", "--name", "ann"});
  EXPECT_TRUE(from_nothing.find_camera);
  EXPECT_FALSE(from_nothing.calibration);
  EXPECT_FALSE(from_nothing.saved_calibration);
  const auto from_file = good({"--calibration", "auto:rough.yaml", "--save-calibration", "found.yaml"});
  EXPECT_TRUE(from_file.find_camera);
  EXPECT_EQ(from_file.calibration, "rough.yaml");
  EXPECT_EQ(from_file.saved_calibration, "found.yaml");
  EXPECT_FALSE(good({"--calibration", "camera.yaml"}).find_camera);
  EXPECT_FALSE(good({"--calibration", "camera.yaml"}).exact_camera);
  const auto exact = good({"--calibration", "exact:camera.yaml"});
  EXPECT_FALSE(exact.find_camera);
  EXPECT_TRUE(exact.exact_camera);
  EXPECT_EQ(exact.calibration, "camera.yaml");
  EXPECT_THAT(wrong({"--calibration", "auto", "--role", "reader"}), HasSubstr("keyframes"));
  EXPECT_THAT(wrong({"--calibration", "exact:"}), HasSubstr("FILE is missing"));
  EXPECT_THAT(wrong({"--calibration", "exact:camera.yaml", "--save-calibration", "found.yaml"}),
              HasSubstr("auto:FILE"));
}

TEST(TrackOptions, ASourceIsRequired) {
  const auto parsed = parse({});
  ASSERT_TRUE(std::holds_alternative<ParseExit>(parsed));
  EXPECT_EQ(std::get<ParseExit>(parsed).code, 2);
  EXPECT_THAT(std::get<ParseExit>(parsed).text, HasSubstr("--source"));
}

TEST(TrackOptions, HelpAndVersionEndWell) {
  for (const char* word : {"--help", "-h", "--version"}) {
    const auto parsed = parse({word});
    ASSERT_TRUE(std::holds_alternative<ParseExit>(parsed)) << word;
    EXPECT_EQ(std::get<ParseExit>(parsed).code, 0) << word;
    EXPECT_THAT(std::get<ParseExit>(parsed).text, HasSubstr("cairn-track")) << word;
  }
}

TEST(DefaultClientName, IsAlwaysAValidNameThatEndsWithTheProcess) {
  for (const char* host :
       {"desk", "Desk_7.local", "", "..", "ünïcode", "a-very-long-host-name-of-more-than-32-letters"}) {
    for (const int pid : {1, 4194304}) {
      const auto name = default_client_name(host, pid);
      EXPECT_TRUE(is_valid_name(name)) << name;
      EXPECT_TRUE(name.ends_with(std::string("-").append(std::to_string(pid)))) << name;
    }
  }
  EXPECT_EQ(default_client_name("Desk_7.local", 5), "desk-7-5");
}

}  // namespace
}  // namespace cairn
