// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <unistd.h>

#include <cstdlib>
#include <optional>

#include "client/capture/frame_source.h"
#include "tests/world/camera_feed.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;

class SimulatedRigSource : public ::testing::Test {
 protected:
  void SetUp() override {
    auto feed = CameraFeed::open(path_);
    ASSERT_TRUE(feed) << feed.error().message;
    feed_.emplace(*std::move(feed));
    auto source = open_source("sim:shoulder?noise=0&blur=0.25&rig=" + path_);
    ASSERT_TRUE(source) << source.error().message;
    source_ = *std::move(source);
    tell(0);
  }
  /// So many milliseconds after the first moment, from where the wearer stands.
  void tell(int millisecond) {
    const SE3 ahead(Eigen::Quaterniond(Eigen::Matrix3d{{0, 0, 1}, {-1, 0, 0}, {0, -1, 0}}), {-2, 0, 0});
    const SE3 turned(so3_exp({0, 0, millisecond < 500 ? 0.0 : 0.5}), Eigen::Vector3d::Zero());
    feed_->tell({{kBegin + int64_t{millisecond} * 1'000'000}, ahead * turned});
  }
  Frame take() {
    auto item = source_->next();
    EXPECT_TRUE(item && *item) << (item ? "the end" : item.error().message);
    return item && *item ? **item : Frame{};
  }
  static constexpr int64_t kBegin = 1'700'000'000'000'000'000;
  const std::string path_ = ::testing::TempDir() + "simulated_rig_" + std::to_string(getpid());
  std::optional<CameraFeed> feed_;
  std::unique_ptr<FrameSource> source_;
};

double difference(const GrayImage& a, const GrayImage& b) {
  double sum = 0;
  for (int y = 0; y < a.height(); ++y) {
    for (int x = 0; x < a.width(); ++x) sum += std::abs(int{a.row(y)[x]} - int{b.row(y)[x]});
  }
  return sum / a.height() / a.width();
}

TEST_F(SimulatedRigSource, RendersFromWhereTheCameraIsOnceTheExposureIsOver) {
  EXPECT_TRUE(source_->is_live());
  ASSERT_TRUE(source_->builtin_calibration());
  for (int t = 10; t <= 40; t += 10) tell(t);
  const Frame first = take();
  EXPECT_EQ(first.index, 1U);
  EXPECT_NEAR(static_cast<double>(first.time.nanoseconds - kBegin), 1e9 / 30, 10);
  for (int t = 50; t <= 80; t += 10) tell(t);
  const Frame second = take();
  EXPECT_EQ(second.index, 2U);
  EXPECT_EQ(difference(*first.image, *second.image), 0);  // it stood still
  for (int t = 500; t <= 600; t += 10) tell(t);
  const Frame third = take();
  EXPECT_EQ(third.index, 17U);                            // what nobody took in time is left out
  EXPECT_GT(difference(*first.image, *third.image), 10);  // it has turned
}

/// It would be taken for honoured.
TEST_F(SimulatedRigSource, OptionsOfWhatTheRigDoesAreRefused) {
  for (const char* option :
       {"imu=200", "hands=3", "blackouts=1", "jerks=1", "speed=2", "exposure=0.1", "frames=9"}) {
    const auto source = open_source("sim:shoulder?" + std::string(option) + "&rig=" + path_);
    ASSERT_FALSE(source) << option;
    EXPECT_EQ(source.error().code, ErrorCode::kUsage);
    EXPECT_THAT(source.error().message, HasSubstr("with rig= there is no option"));
  }
  EXPECT_TRUE(
      open_source("sim:shoulder?seed=2&camera=shoulder&light=later&walks=slow&rolling=0.1&rig=" + path_));
}

TEST_F(SimulatedRigSource, EndsWithItsRig) {
  feed_.reset();
  const auto item = source_->next();
  ASSERT_TRUE(item);
  EXPECT_FALSE(*item);
  const auto none = open_source("sim:shoulder?rig=" + path_);
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(none.error().message, HasSubstr("cairn-rig simulate --camera"));
}

}  // namespace
}  // namespace cairn
