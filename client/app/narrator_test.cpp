// SPDX-License-Identifier: Apache-2.0
#include "client/app/narrator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <algorithm>
#include <sstream>

#include "client/app/test_doubles.h"

namespace cairn {
namespace {

using testing::at_ms;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::make_frame;

/// What is said of frames, 30 a second, warnings only or all.
class Narration {
 public:
  explicit Narration(spdlog::level::level_enum level = spdlog::level::warn) { log_->set_level(level); }

  /// From frame `first` on, until `end`.
  std::string of_imu(size_t first, size_t end, ImuUse imu, const std::string& rig = {}) {
    said_.str({});
    for (size_t i = first; i < end; ++i) {
      const Frame frame = make_frame(i, at_ms(static_cast<int64_t>(i) * 100 / 3));
      FrameResult result;
      result.imu = imu;
      narrator_.on_frame(
          {i, frame, result, FrameState::kStarting, nullptr, nullptr, {}, {}, {}, {}, nullptr, rig});
    }
    return said_.str();
  }

  /// A keyframe is refused for each, one after the other.
  std::string of_refused_keyframes(const std::vector<std::string>& reasons) {
    said_.str({});
    for (const std::string& reason : reasons) {
      OfferReply reply;
      reply.reason = reason;
      narrator_.on_offer_replies({reply});
    }
    return said_.str();
  }

  /// So many seeds a second are refused, for so long, and the run ends.
  std::string of_refused_seeds(int per_second, int seconds, const std::string& reason) {
    said_.str({});
    for (int i = 0; i < per_second * seconds; ++i) {
      narrator_.on_seed_reply({std::nullopt, reason});
      clock_.pass(std::chrono::nanoseconds(std::chrono::seconds(1)) / per_second);
    }
    narrator_.finish();
    return said_.str();
  }

 private:
  std::ostringstream said_;
  Logger log_ =
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(said_));
  testing::ManualClock clock_;
  Narrator narrator_{log_, clock_, std::nullopt};
};

TEST(Narrator, TheSameRefusalIsSaidOnceAndThenHowOften) {
  const std::string said =
      Narration(spdlog::level::info).of_refused_seeds(10, 90, "this client is blocked by ann");
  EXPECT_EQ(std::ranges::count(said, '\n'), 3) << said;
  EXPECT_THAT(said, HasSubstr("refused to start a map: this client is blocked by ann\n"));
  EXPECT_THAT(said, HasSubstr("(599 more like it"));
  EXPECT_THAT(said, HasSubstr("(299 more like it"));
}

TEST(Narrator, RefusalsThatDifferInNumbersAreOne) {
  const std::string said =
      Narration(spdlog::level::info)
          .of_refused_keyframes({"the camera at (1.20, -0.31, 2.00) is outside of the extent",
                                 "the camera at (0.20, 0.31, -12.5) is outside of the extent", "no"});
  EXPECT_EQ(std::ranges::count(said, '\n'), 2) << said;
}

TEST(Narrator, AGapOfTheImuIsSaidAfterTwoSecondsOnceAndItsEndToo) {
  Narration narration(spdlog::level::info);
  (void)narration.of_imu(0, 10, ImuUse::kUsed);
  EXPECT_THAT(narration.of_imu(10, 68, ImuUse::kMissing), IsEmpty()) << "a shorter one is not";
  EXPECT_THAT(narration.of_imu(68, 70, ImuUse::kUsed), IsEmpty());
  const std::string gap = narration.of_imu(70, 300, ImuUse::kMissing);
  EXPECT_THAT(gap, HasSubstr("frame 130: there have been no samples of the IMU for 2 s"));
  EXPECT_EQ(gap.find("no samples"), gap.rfind("no samples"));
  EXPECT_THAT(narration.of_imu(300, 310, ImuUse::kUsed),
              HasSubstr("frame 300: samples of the IMU come again"));
}

TEST(Narrator, AGyroThatContradictsTheImagesIsSaidWithTheRemedyOfItsKind) {
  EXPECT_THAT(Narration().of_imu(0, 10, ImuUse::kContradicts), HasSubstr("--imu-mount"));
  EXPECT_THAT(Narration().of_imu(0, 10, ImuUse::kContradicts, "follows"), HasSubstr("cairn-rig calibrate"));
  EXPECT_THAT(Narration().of_imu(0, 100, ImuUse::kNone), IsEmpty());
}

}  // namespace
}  // namespace cairn
