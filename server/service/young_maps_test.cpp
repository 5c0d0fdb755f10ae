// SPDX-License-Identifier: Apache-2.0
#include "server/service/young_maps.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cairn {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr std::chrono::seconds kWait{10};
constexpr MapId kMap{{1}};
constexpr MapId kOther{{2}};
constexpr MapId kNone{};

/// Anna has made kMap and speaks ten times a second, frame by frame; the time passes as she speaks.
class YoungMapsTest : public ::testing::Test {
 protected:
  YoungMapsTest() { maps_.made(kMap, "anna", kSession); }

  void say(const std::string& client, TrackingState state, MapId map, std::chrono::milliseconds for_as_long,
           SessionId session = kSession) {
    for (const MonotonicTime end = now_ + for_as_long; now_ < end; now_ += 100ms)
      maps_.heard(client, {session, state, map, Timestamp{now_.time_since_epoch().count()}}, now_);
  }
  void track(std::chrono::milliseconds for_as_long) {
    say("anna", TrackingState::kTracking, kMap, for_as_long);
  }
  void lose() { say("anna", TrackingState::kLost, kMap, 2s); }
  void start_anew(std::chrono::milliseconds for_as_long) {
    say("anna", TrackingState::kStarting, kNone, for_as_long);
  }
  void die() {
    track(500ms);
    lose();
  }
  [[nodiscard]] std::vector<MapId> dead() const {
    std::vector<MapId> maps;
    for (const auto& map : maps_.dead(now_, kWait)) maps.push_back(map.map);
    return maps;
  }

  static constexpr SessionId kSession{7};
  YoungMaps maps_;
  MonotonicTime now_{1h};
};

TEST_F(YoungMapsTest, OneThatIsLostAtOnceIsDeadWhenItsMakerHasBeenElsewhereForAWhile) {
  die();
  start_anew(kWait - 1s);
  EXPECT_THAT(dead(), IsEmpty());
  say("anna", TrackingState::kTracking, kOther, 2s);
  EXPECT_THAT(dead(), ElementsAre(kMap));
  const auto known = maps_.dead(now_, kWait);
  EXPECT_EQ(known[0].maker, "anna");
  EXPECT_EQ(known[0].tracked, 500ms);
}

TEST_F(YoungMapsTest, OneThatItsMakerNeverGotIntoIsDead) {
  start_anew(kWait + 1s);
  EXPECT_THAT(dead(), ElementsAre(kMap));
}

TEST_F(YoungMapsTest, TheTimeUntilItsMakerHasItCountsNot) {
  start_anew(kWait - 2s);
  say("anna", TrackingState::kStarting, kMap, 300ms);
  die();
  start_anew(2s);
  EXPECT_THAT(dead(), IsEmpty());
  start_anew(kWait);
  EXPECT_THAT(dead(), ElementsAre(kMap));
}

TEST_F(YoungMapsTest, OneThatWasTrackedForLongerIsNotYoung) {
  track(1200ms);
  lose();
  start_anew(2 * kWait);
  EXPECT_THAT(dead(), IsEmpty());
}

/// For all that is known it was tracked meanwhile.
TEST_F(YoungMapsTest, NorIsOneOfWhichALossWasHeardLate) {
  track(500ms);
  now_ += 1s;
  lose();
  start_anew(2 * kWait);
  EXPECT_THAT(dead(), IsEmpty());
}

TEST_F(YoungMapsTest, NothingIsConcludedFromTimesThatGoBack) {
  track(500ms);
  maps_.heard("anna", {kSession, TrackingState::kLost, kMap, Timestamp{0}}, now_);
  start_anew(2 * kWait);
  EXPECT_THAT(dead(), IsEmpty());
}

TEST_F(YoungMapsTest, WhoIsLostInItMayYetFindBack) {
  track(500ms);
  say("anna", TrackingState::kLost, kMap, 3 * kWait);
  EXPECT_THAT(dead(), IsEmpty());
}

TEST_F(YoungMapsTest, OneThatHasBeenSeenAgainStays) {
  for (const TrackingState state :
       {TrackingState::kTracking, TrackingState::kPoor, TrackingState::kRotation}) {
    maps_.made(kMap, "anna", kSession);
    die();
    start_anew(1s);
    say("anna", state, kMap, 200ms);
    start_anew(2 * kWait);
    EXPECT_THAT(dead(), IsEmpty());
  }
}

TEST_F(YoungMapsTest, OneThatAnotherHasBeenInStays) {
  die();
  say("bert", TrackingState::kTracking, kOther, 200ms);
  start_anew(kWait + 1s);
  EXPECT_THAT(dead(), ElementsAre(kMap));
  say("bert", TrackingState::kPoor, kMap, 200ms);
  start_anew(2 * kWait);
  EXPECT_THAT(dead(), IsEmpty());
}

/// A hypothesis may be rejected.
TEST_F(YoungMapsTest, WhoLooksWhetherItIsThereIsWaitedFor) {
  for (const char* client : {"anna", "bert"}) {
    maps_.made(kMap, "anna", kSession);
    die();
    start_anew(kWait - 1s);
    say(client, TrackingState::kLost, kMap, 200ms);
    start_anew(kWait - 1s);
    EXPECT_THAT(dead(), IsEmpty()) << client;
    start_anew(2s);
    EXPECT_THAT(dead(), ElementsAre(kMap)) << client;
  }
}

TEST_F(YoungMapsTest, OneWhoseMakerHasGoneStays) {
  die();
  start_anew(kWait - 1s);
  maps_.left("anna");
  start_anew(2 * kWait);
  EXPECT_THAT(dead(), IsEmpty());
}

TEST_F(YoungMapsTest, ASilentMakerIsNotElsewhere) {
  die();
  start_anew(1s);
  now_ += 2 * kWait;
  EXPECT_THAT(dead(), IsEmpty());
}

TEST_F(YoungMapsTest, ANewSessionIsAnotherMaker) {
  die();
  say("anna", TrackingState::kStarting, kNone, 2 * kWait, SessionId{8});
  EXPECT_THAT(dead(), IsEmpty());
}

TEST_F(YoungMapsTest, OneThatIsOfUseStays) {
  die();
  maps_.forget(kMap);
  start_anew(2 * kWait);
  EXPECT_THAT(dead(), IsEmpty());
}

}  // namespace
}  // namespace cairn
