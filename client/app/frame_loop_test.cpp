// SPDX-License-Identifier: Apache-2.0
#include "client/app/frame_loop.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client/app/test_doubles.h"

namespace cairn {
namespace {

using ::testing::AllOf;
using testing::at_ms;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::ListSource;
using testing::make_frame;
using testing::ManualClock;
using ::testing::Not;
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
    labels.push_back(report.labels);
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
  void on_relocalization_answer(const PlaceReport& report) override {
    answers.push_back(fmt::format("{} ms: {}{}", (report.asked - Timestamp()).count() / 1'000'000,
                                  to_string(report.answer.verdict), report.tried ? ", tried" : ""));
  }
  void on_status(const SessionStatus& status) override { words.push_back(status.text); }
  void on_camera(const CameraUpdate& update) override {
    words.push_back(fmt::format("camera {}", update.version));
  }
  void on_unsettled(size_t) override { words.emplace_back("unsettled"); }
  void on_start_over(const StartOverReport& report) override { words.push_back(report.reason); }

  std::vector<std::string> states;
  std::vector<size_t> numbers;
  std::vector<LabelListPtr> labels;
  std::vector<std::string> words;
  std::vector<std::string> answers;
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

TEST(FrameLoop, EachFrameComesWithTheSamplesThatItNeeds) {
  std::vector<ImuSample> samples;
  for (int i = 0; i < 100; ++i)
    samples.push_back({at_ms(10 * i), Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()});
  ImuRecording imu({}, samples);
  Rig rig({starting, starting, starting});
  rig.options.imu = &imu;
  ASSERT_TRUE(rig.run());
  ASSERT_EQ(rig.tracker.sample_counts.size(), 3U);
  // Of 0, 33 and 66 ms: up to the first sample behind it.
  EXPECT_THAT(rig.tracker.sample_counts, ElementsAre(1U, 4U, 3U));
  EXPECT_THAT(rig.tracker.words, ElementsAre("IMU with 0 ms")) << "told once, before the first frame";
  EXPECT_EQ(rig.tracker.words_before_first_frame, 1U);
}

/// A rig learns at work how its IMU sits, and how its clock goes.
TEST(FrameLoop, TheTrackerIsToldOfAnotherMountOfTheImu) {
  ImuQueue imu;
  const auto mounted = [&imu](int ms) {
    return [&imu, ms](FrameResult& result) {
      starting(result);
      imu.set_mount(
          ms < 0 ? std::nullopt
                 : std::optional(ImuMount{Eigen::Quaterniond::Identity(), std::chrono::milliseconds(ms)}));
    };
  };
  Rig rig({mounted(5), mounted(5), mounted(7), mounted(-1), starting});
  rig.options.imu = &imu;
  imu.put(EncoderSample{at_ms(0)});
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.tracker.words, ElementsAre("IMU with 5 ms", "IMU with 7 ms", "no IMU"));
  EXPECT_EQ(rig.tracker.encoder_count, 1U);
}

TEST(FrameLoop, AFrameIsReportedWithTheLabelsOfItsMap) {
  Rig rig({starting, tracking});
  auto map = std::make_shared<MapSnapshot>();
  map->map = kMap;
  rig.link.map = map;
  rig.link.map_labels = std::make_shared<const std::vector<Label>>(1);
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.notes.labels, ElementsAre(nullptr, rig.link.map_labels));
}

TEST(FrameLoop, AStateWithoutAMeasuredPoseIsNotTracked) {
  const auto unmeasured = [](FrameResult& result) {
    tracking(result);
    result.pose_measured = false;
  };
  Rig rig({unmeasured, tracking, unmeasured});
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.notes.states, ElementsAre("lost", "tracking", "lost"));
}

void asking(FrameResult& result) {
  lost(result);
  result.reloc_query = std::make_shared<const PlaceView>();
}

RelocalizationAnswer place_in(MapId map, RelocalizationVerdict verdict) {
  RelocalizationAnswer answer;
  answer.verdict = verdict;
  answer.candidates.resize(1);
  answer.candidates[0].map = map;
  answer.candidates[0].revision = Revision{5};
  answer.candidates[0].confirmed = verdict == RelocalizationVerdict::kConfirmed;
  return answer;
}

TEST(FrameLoop, QueriesAreSentAndOnlyLockstepWaitsForTheAnswer) {
  for (const Pace pace : {Pace::kMax, Pace::kRealtime, Pace::kLockstep}) {
    Rig rig({tracking, asking, lost});
    rig.options.pace = pace;
    ASSERT_TRUE(rig.run());
    if (pace == Pace::kLockstep) {
      EXPECT_THAT(rig.link.sent, ElementsAre("query", "settle"));
    } else {
      EXPECT_THAT(rig.link.sent, ElementsAre("query"));
    }
  }
}

TEST(FrameLoop, AMapIsUsedWhenAPlaceInItIsWanted) {
  struct Case {
    RelocalizationVerdict verdict;
    PlaceUse use;
    std::string word;
    std::vector<std::string> sent;
  };
  const std::vector<Case> cases = {
      {RelocalizationVerdict::kConfirmed, PlaceUse::kToVerify, "try a place", {"use 7 at 5"}},
      {RelocalizationVerdict::kUnconfirmed, PlaceUse::kToVerify, "try a place, unconfirmed", {"use 7 at 5"}},
      {RelocalizationVerdict::kConfirmed, PlaceUse::kNotNeeded, "try a place", {}},
      {RelocalizationVerdict::kConfirmed, PlaceUse::kNotKnown, "try a place", {}},
      {RelocalizationVerdict::kNotKnown, PlaceUse::kToVerify, "place not known", {}},
      {RelocalizationVerdict::kNotThere, PlaceUse::kToVerify, "left open", {}},
  };
  for (const Case& c : cases) {
    Rig rig({starting, starting});
    rig.tracker.use_of_places = c.use;
    rig.link.relocalization_answer = place_in(MapId{{7}}, c.verdict);
    ASSERT_TRUE(rig.run());
    EXPECT_THAT(rig.tracker.words, ElementsAre(c.word));
    EXPECT_EQ(rig.link.sent, c.sent);
  }
}

TEST(FrameLoop, InLockstepTheNextFrameWaitsForTheReplicaOfThePlace) {
  Rig rig({asking, lost});
  rig.options.pace = Pace::kLockstep;
  rig.link.on_settled = [&rig] {
    rig.link.relocalization_answer = place_in(MapId{{7}}, RelocalizationVerdict::kConfirmed);
  };
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.link.sent, ElementsAre("query", "settle", "use 7 at 5", "settle"));
}

TEST(FrameLoop, AnAnswerIsReportedWithTheFrameThatWasAskedAbout) {
  Rig rig({lost, asking, lost, asking, lost});
  rig.options.pace = Pace::kLockstep;
  rig.link.on_settled = [&rig] {
    rig.link.relocalization_answer = place_in(MapId{{7}}, RelocalizationVerdict::kUnconfirmed);
    rig.link.on_settled = [&rig] {  // of the replica
      rig.link.on_settled = [&rig] {
        rig.link.relocalization_answer = place_in(MapId{{7}}, RelocalizationVerdict::kNotThere);
      };
    };
  };
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.notes.answers, ElementsAre("33 ms: unconfirmed, tried", "99 ms: not there"));
}

TEST(FrameLoop, ATrackerThatFindsBackByItselfStaysInItsMap) {
  Rig rig({lost, lost, tracking, tracking});
  rig.link.relocalization_answer = place_in(MapId{{7}}, RelocalizationVerdict::kConfirmed);
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.link.sent, ElementsAre("use 7 at 5", "use 1 at 0"));

  Rig verified({lost, lost, tracking, tracking});
  verified.link.relocalization_answer = place_in(kMap, RelocalizationVerdict::kConfirmed);
  ASSERT_TRUE(verified.run());
  EXPECT_THAT(verified.link.sent, ElementsAre("use 1 at 5"));
}

TEST(FrameLoop, AMapWhosePlaceDoesNotHoldIsLeftForTheOneLastTrackedIn) {
  const auto verifying = [](FrameResult& result) {
    lost(result);
    result.map = MapId{{7}};
    result.verifying = true;
  };
  const auto rejected = [](FrameResult& result) {
    lost(result);
    result.map = MapId{{7}};
  };
  for (const auto& verification : {std::vector<ScriptedTracker::Step>{rejected}, {verifying, rejected}}) {
    std::vector<ScriptedTracker::Step> script = {tracking, asking};
    script.insert(script.end(), verification.begin(), verification.end());
    script.emplace_back(lost);
    Rig rig(script);
    rig.options.pace = Pace::kLockstep;
    rig.link.on_settled = [&rig] {
      rig.link.relocalization_answer = place_in(MapId{{7}}, RelocalizationVerdict::kConfirmed);
    };
    ASSERT_TRUE(rig.run());
    EXPECT_THAT(rig.link.sent, ElementsAre("query", "settle", "use 7 at 5", "settle", "use 1 at 0"));
  }
  Rig never_tracked({lost, rejected, lost});
  never_tracked.link.relocalization_answer = place_in(MapId{{7}}, RelocalizationVerdict::kConfirmed);
  ASSERT_TRUE(never_tracked.run());
  EXPECT_THAT(never_tracked.link.sent, ElementsAre("use 7 at 5"));
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

TEST(FrameLoop, AReaderProposesWhereThatIsWelcomeAndOneInAWhile) {
  ScriptedLink* link = nullptr;
  const auto proposing = [](FrameResult& result) {
    with_keyframe(result);
    result.keyframe->number = 5;
  };
  const auto answered = [&link](FrameResult& result) {
    tracking(result);
    link->offer_replies = {{1, false, "kept aside", {}, {}, 5, true}};
  };
  // A frame a second. The proposal is decided with the sixth, and three seconds have passed then.
  Rig rig(std::vector<ScriptedTracker::Step>{tracking, proposing, tracking, tracking, tracking, answered,
                                             tracking, tracking},
          regular_frames(8, 1000));
  link = &rig.link;
  rig.link.map = std::make_shared<MapSnapshot>();
  rig.link.use_of_keyframes = KeyframeUse::kProposal;
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.tracker.keyframes_wanted, ElementsAre(true, true, false, false, false, false, true, true));
  EXPECT_THAT(rig.link.sent, ElementsAre("offer"));

  // Decided at once, it is not asked for the next before its time.
  Rig early(std::vector<ScriptedTracker::Step>{proposing, answered, tracking, tracking, tracking},
            regular_frames(5, 1000));
  link = &early.link;
  early.link.map = rig.link.map;
  early.link.use_of_keyframes = KeyframeUse::kProposal;
  ASSERT_TRUE(early.run());
  EXPECT_THAT(early.tracker.keyframes_wanted, ElementsAre(true, false, false, true, true));

  for (const auto& [use, wanted] :
       {std::pair(KeyframeUse::kNothing, false), {KeyframeUse::kKeyframe, true}}) {
    Rig other({tracking, tracking});
    other.link.map = rig.link.map;
    other.link.use_of_keyframes = use;
    ASSERT_TRUE(other.run());
    EXPECT_THAT(other.tracker.keyframes_wanted, ElementsAre(wanted, wanted));
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
  EXPECT_EQ(rig.tracker.words_before_first_frame, 1U);
  EXPECT_THAT(rig.notes.words, ElementsAre("seed reply", "accepted", "refused: too near", ""));

  Rig accepted({starting});
  accepted.link.seed_reply = SeedReply{SeedAnswer{}, ""};
  ASSERT_TRUE(accepted.run());
  EXPECT_THAT(accepted.tracker.words, ElementsAre("accepted"));
}

TEST(FrameLoop, TheCameraOfARevisionIsInUseBeforeItIsTracked) {
  const auto other = make_camera({CameraModel::kPinholeRadtan, 64, 48, {71, 71, 31.5, 23.5, 0, 0, 0, 0, 0}});
  Rig rig({tracking, tracking});
  rig.link.camera = CameraUpdate{2, *other, 0.02, 0.01, true, false};
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.tracker.words, IsEmpty()) << "without a map there is none that it belongs to";

  Rig in_map({tracking, tracking});
  in_map.link.map = std::make_shared<MapSnapshot>();
  in_map.link.camera = CameraUpdate{2, *other, 0.02, 0.01, true, false};
  ASSERT_TRUE(in_map.run());
  EXPECT_THAT(in_map.tracker.words, ElementsAre("camera of 71 px at frame 0"));
  EXPECT_THAT(in_map.notes.words, ::testing::Contains("camera 2"));

  Rig without({tracking});
  without.link.first_camera = CameraUpdate{0, *other, 0.35, 0.1, false, false};
  ASSERT_TRUE(without.run());
  EXPECT_THAT(without.tracker.words, ElementsAre("camera of 71 px at frame 0")) << "a map was left";
}

TEST(FrameLoop, AStatusIsToldWhenItChangesAndNotBefore) {
  Rig rig(
      {starting, starting, [&rig](FrameResult&) { rig.link.session_status.text = "server gone"; }, starting});
  rig.link.session_status.text = "connected";
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.notes.words, ElementsAre("connected", "server gone"));
}

TEST(FrameLoop, AMapThatTheServerLostIsKeptWhileTrackedAndLeftWhenLost) {
  Rig rig({tracking, tracking, lost});
  rig.link.session_status.map_known = false;
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.tracker.words, ElementsAre("start over"));
  EXPECT_THAT(rig.link.sent, ElementsAre("leave"));

  Rig reader({tracking, lost, lost});
  reader.link.session_status.map_known = false;
  reader.options.make_maps = false;
  ASSERT_TRUE(reader.run());
  EXPECT_THAT(reader.link.sent, ::testing::Contains("leave")) << "for another map of the server's";

  Rig known({tracking, lost, lost});
  ASSERT_TRUE(known.run());
  EXPECT_THAT(known.tracker.words, IsEmpty());

  Rig begun({starting});
  begun.link.session_status.map_known = false;
  ASSERT_TRUE(begun.run());
  EXPECT_THAT(begun.tracker.words, ElementsAre("start over")) << "a map that was accepted and never came";
}

TEST(FrameLoop, ABuilderLostWhereNoMapIsKnownBeginsOneAndAReaderDoesNot) {
  std::vector<ScriptedTracker::Step> script(8, lost);
  script[0] = tracking;
  script[3] = tracking;  // the wait begins anew
  for (const bool makes_maps : {true, false}) {
    Rig rig(script, regular_frames(8, 500));
    rig.link.always_answer = RelocalizationAnswer{};
    rig.options.make_maps = makes_maps;
    rig.options.lost_patience = std::chrono::milliseconds(1500);
    ASSERT_TRUE(rig.run());
    if (makes_maps) {
      EXPECT_THAT(rig.notes.words, ElementsAre("", "lost for 1.5 s where no map is known"));
      EXPECT_THAT(rig.tracker.words, ::testing::Contains("start over").Times(1));
    } else {
      EXPECT_THAT(rig.tracker.words, AllOf(Not(IsEmpty()), Each("place not known")));
    }
  }
}

TEST(FrameLoop, ABuilderNotYetTrackedAnywhereGoesOnStartingWhenAHypothesisDoesNotHold) {
  Rig rig({starting, lost, lost, starting});
  rig.link.always_answer = RelocalizationAnswer{};
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.tracker.words, ::testing::Contains("start over").Times(1));
}

TEST(FrameLoop, APlaceThatIsNotNeededIsNoWordOfAPlaceNotKnown) {
  for (const PlaceUse use : {PlaceUse::kNotNeeded, PlaceUse::kNotKnown}) {
    Rig rig({starting, lost, lost, starting});
    rig.tracker.use_of_places = use;
    rig.link.always_answer = place_in(MapId{{7}}, RelocalizationVerdict::kConfirmed);
    ASSERT_TRUE(rig.run());
    EXPECT_THAT(rig.tracker.words,
                ::testing::Contains("start over").Times(use == PlaceUse::kNotKnown ? 1 : 0));
  }
}

TEST(FrameLoop, WhereAPlaceIsLeftOpenALostBuilderBeginsNoMap) {
  std::vector<ScriptedTracker::Step> script(8, lost);
  script[0] = tracking;
  Rig rig(script, regular_frames(8, 500));
  rig.link.always_answer = place_in(MapId{{7}}, RelocalizationVerdict::kNotThere);
  rig.options.lost_patience = std::chrono::milliseconds(1500);
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.tracker.words, AllOf(Not(IsEmpty()), Each("left open")));
}

/// It may be that the place is known: then a map of it is there already, and once it is back it says so.
TEST(FrameLoop, WithoutAFreshAnswerALostBuilderBeginsNoMap) {
  std::vector<ScriptedTracker::Step> script(20, lost);
  script[0] = tracking;
  Rig rig(script, regular_frames(20, 500));
  rig.options.lost_patience = std::chrono::milliseconds(1500);
  rig.link.relocalization_answer = RelocalizationAnswer{};  // once
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.tracker.words, ElementsAre("place not known"));
}

TEST(FrameLoop, ACutInTheRecordingIsNotALongLoss) {
  auto items = regular_frames(2, 30);
  items.emplace_back(make_frame(2, at_ms(100'000)));
  Rig rig({tracking, lost, lost}, std::move(items));
  rig.link.always_answer = RelocalizationAnswer{};
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.tracker.words, AllOf(Not(IsEmpty()), Each("place not known")));
}

TEST(FrameLoop, ANewMapIsBegunWhenAskedFor) {
  Rig rig({tracking, tracking, tracking});
  rig.options.new_map_requested = [&rig] { return rig.tracker.times.size() == 2; };
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.tracker.words, ElementsAre("start a new map"));
  EXPECT_THAT(rig.link.sent, ElementsAre("leave"));
}

TEST(FrameLoop, AMapNeverTrackedInIsALossAndNotAStart) {
  Rig rig({starting, lost, lost});
  ASSERT_TRUE(rig.run());
  EXPECT_THAT(rig.notes.states, ElementsAre("starting", "lost", "lost"));
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
