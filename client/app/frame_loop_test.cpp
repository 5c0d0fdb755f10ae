// SPDX-License-Identifier: Apache-2.0
#include "client/app/frame_loop.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client/app/test_doubles.h"

namespace cairn {
namespace {

using testing::at_ms;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::ListSource;
using testing::make_frame;
using testing::ManualClock;
using testing::regular_frames;
using testing::ScriptedLink;
using testing::ScriptedTracker;

bool never() {
  return false;
}
const MapId kMap{{1}};

void starting(FrameResult&) {}
void tracking(FrameResult& result) {
  result.state = TrackingState::kTracking;
  result.pose_measured = true;
  result.map = kMap;
  result.found = 50;
  result.attempted = 80;
}
void lost(FrameResult& result) {
  result.state = TrackingState::kLost;
  result.map = kMap;
}
void with_seed(FrameResult& result) {
  result.seed.emplace();
}
void with_keyframe(FrameResult& result) {
  tracking(result);
  result.keyframe.emplace();
}

/// Keeps the state of every frame and all other words.
class Notes final : public FrameObserver {
 public:
  void on_frame(const FrameReport& report) override {
    states.emplace_back(to_string(report.state));
    numbers.push_back(report.number);
  }
  void on_dropped(const DroppedReport& report) override {
    states.emplace_back("dropped");
    numbers.push_back(report.number);
  }
  void on_undecodable(const UndecodableReport& report) override {
    states.push_back(report.reason);
    numbers.push_back(report.number);
  }
  void on_seed_reply(const SeedReply&) override { words.emplace_back("seed reply"); }
  void on_offer_replies(const std::vector<OfferReply>& replies) override {
    for (const auto& reply : replies)
      words.emplace_back(reply.accepted ? "accepted" : "refused: " + reply.reason);
  }
  void on_status(const SessionStatus& status) override { words.push_back(status.text); }
  void on_unsettled(size_t) override { words.emplace_back("unsettled"); }
  void on_start_over(size_t) override { words.emplace_back("start over"); }

  std::vector<std::string> states;
  std::vector<size_t> numbers;
  std::vector<std::string> words;
};

struct Rig {
  explicit Rig(const std::vector<ScriptedTracker::Step>& script)
      : Rig(script, regular_frames(script.size(), 33)) {}
  Rig(std::vector<ScriptedTracker::Step> script, std::deque<ListSource::Item> items)
      : source(std::move(items)), tracker(std::move(script)) {
    options.pace = Pace::kMax;
    options.width = 64;
    options.height = 48;
  }
  Result<bool> run(const std::function<bool()>& stop = never) {
    return FrameLoop(source, tracker, link, clock, options, {&notes}).run(stop);
  }

  ManualClock clock;
  ListSource source;
  ScriptedTracker tracker;
  ScriptedLink link;
  FrameLoopOptions options;
  Notes notes;
};

TEST(FrameLoop, FramesGoThroughTrackerAndStateIsPublishedForEach) {
  Rig rig({starting, starting, tracking, lost, tracking});
  const auto done = rig.run();
  ASSERT_TRUE(done);
  EXPECT_TRUE(*done);
  EXPECT_THAT(rig.notes.states, ElementsAre("starting", "starting", "tracking", "lost", "tracking"));
  EXPECT_EQ(rig.link.states_published, 5U);
  EXPECT_THAT(rig.link.sent, IsEmpty());
}

TEST(FrameLoop, AStateWithoutAMeasuredPoseIsNotTracked) {
  const auto unmeasured = [](FrameResult& result) {
    tracking(result);
    result.pose_measured = false;
  };
  Rig rig({unmeasured, tracking, unmeasured});
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.notes.states, ElementsAre("starting", "tracking", "lost"));
}

void asking(FrameResult& result) {
  lost(result);
  result.place_question = std::make_shared<const PlaceView>();
}

PlaceAnswer place_in(const MapSnapshotPtr& map, PlaceVerdict verdict) {
  PlaceAnswer answer;
  answer.verdict = verdict;
  answer.candidates.resize(1);
  answer.candidates[0].map = map->map;
  answer.candidates[0].confirmed = verdict == PlaceVerdict::kConfirmed;
  return answer;
}

TEST(FrameLoop, QuestionsAreSentAndOnlyLockstepWaitsForTheAnswer) {
  for (const Pace pace : {Pace::kMax, Pace::kRealtime, Pace::kLockstep}) {
    Rig rig({tracking, asking, lost});
    rig.options.pace = pace;
    ASSERT_TRUE(rig.run());
    if (pace == Pace::kLockstep) {
      EXPECT_THAT(rig.link.sent, ElementsAre("question", "settle"));
    } else {
      EXPECT_THAT(rig.link.sent, ElementsAre("question"));
    }
  }
}

TEST(FrameLoop, AnAnswerIsForTheMapInUse) {
  auto map = std::make_shared<MapSnapshot>();
  map->map.bytes[0] = 1;
  auto other = std::make_shared<MapSnapshot>();
  other->map.bytes[0] = 2;
  const std::vector<std::pair<PlaceAnswer, std::string>> cases = {
      {place_in(map, PlaceVerdict::kConfirmed), "try a place"},
      {place_in(map, PlaceVerdict::kUnconfirmed), "try a place"},
      {place_in(map, PlaceVerdict::kNotKnown), "place not known"},
      {place_in(other, PlaceVerdict::kConfirmed), "place not known"},
  };
  for (const auto& [answer, word] : cases) {
    Rig rig({lost, lost});
    rig.link.map = map;
    rig.link.place_answer = answer;
    ASSERT_TRUE(rig.run());
    EXPECT_THAT(rig.tracker.words, ElementsAre(word));
  }
}

TEST(FrameLoop, ProposalsAreSentAndOnlyLockstepWaitsForThem) {
  for (const Pace pace : {Pace::kMax, Pace::kRealtime, Pace::kLockstep}) {
    Rig rig({with_seed, starting, with_keyframe, tracking});
    rig.options.pace = pace;
    ASSERT_TRUE(rig.run());
    if (pace == Pace::kLockstep) {
      EXPECT_THAT(rig.link.sent, ElementsAre("seed", "settle", "offer", "settle"));
    } else {
      EXPECT_THAT(rig.link.sent, ElementsAre("seed", "offer"));
    }
  }
}

TEST(FrameLoop, AServerThatDoesNotSettleIsToldAndTheRunGoesOn) {
  Rig rig({with_seed, starting, starting});
  rig.options.pace = Pace::kLockstep;
  rig.link.settles = false;
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.notes.words, ::testing::Contains("unsettled"));
  EXPECT_EQ(rig.notes.states.size(), 3U);
}

TEST(FrameLoop, RepliesReachTheTrackerBeforeTheNextFrame) {
  Rig rig({starting});
  rig.link.seed_reply = SeedReply{std::nullopt, "no parallax"};
  rig.link.offer_replies = {{1, true, ""}, {2, false, "too near"}};
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.tracker.words, ElementsAre("refused: no parallax"));
  EXPECT_THAT(rig.notes.words, ElementsAre("seed reply", "accepted", "refused: too near", ""));

  Rig accepted({starting});
  accepted.link.seed_reply = SeedReply{SeedAnswer{}, ""};
  ASSERT_TRUE(accepted.run());
  EXPECT_THAT(accepted.tracker.words, ElementsAre("accepted"));
}

TEST(FrameLoop, AStatusIsToldWhenItChangesAndNotBefore) {
  Rig rig(
      {starting, starting, [&rig](FrameResult&) { rig.link.session_status.text = "server gone"; }, starting});
  rig.link.session_status.text = "connected";
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.notes.words, ElementsAre("connected", "server gone"));
}

TEST(FrameLoop, AMapThatTheServerLostIsKeptWhileTrackedAndLeftWhenLost) {
  Rig rig({tracking, tracking, lost, starting});
  rig.link.session_status.map_known = false;
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.tracker.words, ElementsAre("start over"));
  EXPECT_THAT(rig.link.sent, ElementsAre("leave"));

  Rig reader({tracking, lost, lost});
  reader.link.session_status.map_known = false;
  reader.options.make_maps = false;
  ASSERT_TRUE(reader.run());
  EXPECT_THAT(reader.tracker.words, IsEmpty());

  Rig known({tracking, lost, lost});
  ASSERT_TRUE(known.run());
  EXPECT_THAT(known.tracker.words, IsEmpty());
}

TEST(FrameLoop, EveryFrameOfTheSourceIsNumberedOnce) {
  auto items = regular_frames(6, 30);
  items[1] = fail(ErrorCode::kDamaged, "1.png: cut");
  Rig rig(std::vector<ScriptedTracker::Step>(6, [](FrameResult&) {}), std::move(items));
  rig.options.pace = Pace::kRealtime;
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.notes.numbers, ElementsAre(0, 1, 2, 3, 4, 5));
  EXPECT_EQ(rig.notes.states[1], "1.png: cut");
  EXPECT_EQ(rig.tracker.times.size(), 5U);
}

TEST(FrameLoop, ACalibrationOfAnotherSizeIsAnErrorThatNamesBoth) {
  Rig rig({starting}, regular_frames(1, 30));
  rig.options.width = 640;
  rig.options.height = 480;
  const auto done = rig.run();
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, ErrorCode::kConfiguration);
  EXPECT_THAT(done.error().message, HasSubstr("64x48"));
  EXPECT_THAT(done.error().message, HasSubstr("640x480"));
}

TEST(FrameLoop, ALaterFrameOfAnotherSizeIsSkipped) {
  auto items = regular_frames(3, 30);
  items[1] = make_frame(1, at_ms(30), 32, 24);
  Rig rig({starting, starting}, std::move(items));
  ASSERT_TRUE(rig.run());
  EXPECT_EQ(rig.tracker.times.size(), 2U);
  EXPECT_THAT(rig.notes.states[1], HasSubstr("32x24"));
}

TEST(FrameLoop, ASourceWithoutAReadableFrameIsDamaged) {
  std::deque<ListSource::Item> items;
  items.emplace_back(fail(ErrorCode::kDamaged, "a.png: empty"));
  Rig rig({}, std::move(items));
  const auto done = rig.run();
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, ErrorCode::kDamaged);
  EXPECT_THAT(done.error().message, HasSubstr("a.png"));
}

TEST(FrameLoop, ARequestToStopIsNotAnEndOfTheSource) {
  Rig rig(std::vector<ScriptedTracker::Step>(10, starting));
  const auto done = rig.run([&rig] { return rig.tracker.times.size() >= 3; });
  ASSERT_TRUE(done);
  EXPECT_FALSE(*done);
  EXPECT_EQ(rig.tracker.times.size(), 3U);
}

}  // namespace
}  // namespace cairn
