// SPDX-License-Identifier: Apache-2.0
#include "client/capture/stamp_check.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;

constexpr double kEpoch = 1403715273.262;  // [s]

/// Stamps of a camera whose steps waver by a tenth [s].
std::vector<double> camera(double period, size_t count, double begin = kEpoch) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> waver(-0.1, 0.1);
  std::vector<double> times;
  for (size_t i = 0; i < count; ++i)
    times.push_back(begin + period * (static_cast<double>(i) + waver(random) / 2));
  return times;
}

/// What a reader of seconds makes of them after `written` has become of each.
template <typename Written>
std::vector<Timestamp> read(const std::vector<double>& times, Written written) {
  std::vector<Timestamp> stamps;
  for (const double time : times) stamps.push_back(Timestamp::from_seconds(written(time)));
  return stamps;
}

StampReport check_seconds(const std::vector<Timestamp>& stamps) {
  return check_stamps(stamps, TimeUnit::kSeconds);
}

TEST(StampCheck, CamerasOfEveryRatePass) {
  for (const double rate : {1.0, 2.0, 15.0, 30.0, 60.0, 120.0, 240.0, 1000.0}) {
    const auto report = check_seconds(read(camera(1 / rate, 50), [](double t) { return t; }));
    EXPECT_FALSE(report.impossible) << rate << *report.impossible;
    EXPECT_TRUE(rate <= 1 || report.remarks.empty()) << rate;
  }
}

TEST(StampCheck, ARecordingWithRepeatedAndLostFramesPasses) {
  auto times = camera(1.0 / 30, 100);
  for (size_t i = 0; i < 40; ++i) times[2 * i + 1] = times[2 * i];
  times.erase(times.begin() + 80, times.begin() + 95);
  EXPECT_FALSE(check_seconds(read(times, [](double t) { return t; })).impossible);
}

TEST(StampCheck, OtherUnitsAreNamed) {
  for (const double rate : {5.0, 30.0, 200.0}) {
    const auto times = camera(1 / rate, 30, 0);
    for (const auto& [factor, name] :
         {std::pair(1e3, "milliseconds"), std::pair(1e6, "microseconds"), std::pair(1e9, "nanoseconds")}) {
      const auto report = check_seconds(read(times, [f = factor](double t) { return std::round(t * f); }));
      ASSERT_TRUE(report.impossible) << rate << name;
      EXPECT_THAT(*report.impossible, HasSubstr(name)) << rate;
    }
    const auto days = check_seconds(read(times, [](double t) { return 45000 + t / 86400; }));
    ASSERT_TRUE(days.impossible);
    EXPECT_THAT(*days.impossible, HasSubstr("days"));
  }
  const auto list_of_microseconds = read(camera(0.05, 30), [](double t) { return t / 1e3; });
  const auto report = check_stamps(list_of_microseconds, TimeUnit::kNanoseconds);
  ASSERT_TRUE(report.impossible);
  EXPECT_THAT(report.remedy, HasSubstr("unit=us"));
}

TEST(StampCheck, LostDigitsAreNamed) {
  const auto times = camera(1.0 / 30, 9000);
  const auto why = [&](auto written) { return check_seconds(read(times, written)).impossible.value_or(""); };
  EXPECT_THAT(why([](double t) { return std::floor(t); }), HasSubstr("whole seconds"));
  EXPECT_THAT(why([](double t) { return double{static_cast<float>(t)}; }), HasSubstr("32-bit"));
  EXPECT_THAT(why([](double t) { return std::round(t / 10) * 10; }), HasSubstr("spreadsheet"));
  EXPECT_THAT(why([](double t) { return std::round((45000 + (t - kEpoch) / 86400) * 1e6) / 1e6; }),
              HasSubstr("days"));
  EXPECT_THAT(why([](double) { return 7.0; }), HasSubstr("all are the same whole second"));
  EXPECT_THAT(why([](double) { return 7.1; }), EndsWith("all are the same"));
}

TEST(StampCheck, StillsAndListsOfPlacesAreToldAndPass) {
  std::vector<double> stills;  // numbers of the images that were kept
  for (const int number : {1, 2, 3, 4, 6, 7, 12, 14, 18, 19, 21, 25, 54, 72}) stills.push_back(number);
  auto report = check_seconds(read(stills, [](double t) { return t; }));
  EXPECT_FALSE(report.impossible);
  EXPECT_THAT(report.remarks, ElementsAre(HasSubstr("the median step of the stamps is 2 s")));

  std::vector<double> places;  // pieces of one recording, in any order
  for (const double begin : {60.0, 10.0, 95.0, 33.0}) {
    for (int i = 0; i < 25; ++i) places.push_back(begin + i / 30.0);
  }
  report = check_seconds(read(places, [](double t) { return t; }));
  EXPECT_FALSE(report.impossible);
  EXPECT_THAT(report.remarks, ElementsAre(HasSubstr("2 of 100 stamps go back, stamp 26 as the first")));

  std::vector<double> queries;  // single images of it
  std::mt19937 random(5);
  for (int i = 0; i < 40; ++i) queries.push_back(static_cast<double>(random() % 1000) / 10);
  EXPECT_FALSE(check_seconds(read(queries, [](double t) { return t; })).impossible);
}

TEST(StampCheck, AFewStampsSayNothingOfTheirUnit) {
  EXPECT_FALSE(check_seconds(read({0, 33, 66, 99}, [](double t) { return t; })).impossible);
  EXPECT_FALSE(check_seconds({}).impossible);
  EXPECT_FALSE(check_seconds(read({1}, [](double t) { return t; })).impossible);
}

TEST(StampCheck, ACounterThatBeginsAgainIsNamed) {
  constexpr double kWrap = 4294.967296;
  const auto report =
      check_seconds(read(camera(1.0 / 30, 300, 3 * kWrap - 5), [](double t) { return std::fmod(t, kWrap); }));
  EXPECT_FALSE(report.impossible);
  EXPECT_THAT(report.remarks, ElementsAre(HasSubstr("32-bit counter does that begins again after 4295 s")));
}

TEST(StampCheck, AListThatRunsBackwardsIsTold) {
  auto times = camera(1.0 / 30, 100);
  std::reverse(times.begin(), times.end());
  const auto report = check_seconds(read(times, [](double t) { return t; }));
  EXPECT_FALSE(report.impossible);
  EXPECT_THAT(report.remarks, ElementsAre(HasSubstr("99 of 100 stamps go back")));
}

}  // namespace
}  // namespace cairn
