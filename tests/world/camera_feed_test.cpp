// SPDX-License-Identifier: Apache-2.0
#include "tests/world/camera_feed.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

namespace cairn {
namespace {

using std::chrono::milliseconds;

class Feed : public ::testing::Test {
 protected:
  CameraFeed open() {
    auto feed = CameraFeed::open(path_);
    EXPECT_TRUE(feed) << feed.error().message;
    return *std::move(feed);
  }
  static CameraMoment at(int64_t millisecond) {
    return {{millisecond * 1'000'000},
            SE3(so3_exp({0, 0, 0.01 * static_cast<double>(millisecond)}),
                Eigen::Vector3d(static_cast<double>(millisecond), 0, 0))};
  }
  const std::string path_ = ::testing::TempDir() + "camera_feed_" + std::to_string(getpid());
};

TEST_F(Feed, WhatIsToldArrivesAndIsKnownInBetween) {
  CameraFeed feed = open();
  auto truth = CameraTruth::join(path_);
  ASSERT_TRUE(truth);
  EXPECT_EQ(truth->wait(milliseconds(0)), CameraTruth::News::kNone);
  EXPECT_FALSE(truth->newest());
  for (int i = 1; i <= 3; ++i) feed.tell(at(i));
  EXPECT_EQ(truth->wait(milliseconds(1000)), CameraTruth::News::kSome);
  ASSERT_TRUE(truth->newest());
  EXPECT_EQ(truth->newest()->nanoseconds, 3'000'000);
  const SE3 between = truth->map_from_camera({1'500'000});
  EXPECT_NEAR(between.translation().x(), 1.5, 1e-12);
  EXPECT_NEAR(so3_log(between.rotation()).z(), 0.015, 1e-12);
  EXPECT_EQ(truth->map_from_camera({0}).translation().x(), 1);
  EXPECT_EQ(truth->map_from_camera({9'000'000}).translation().x(), 3);
}

TEST_F(Feed, EachOfSeveralHearsAndOneThatDoesNotReadIsNoHindrance) {
  CameraFeed feed = open();
  auto idle = CameraTruth::join(path_);
  auto quick = CameraTruth::join(path_);
  ASSERT_TRUE(idle && quick);
  for (int i = 0; i < 5000; ++i) {
    feed.tell(at(i));
    ASSERT_EQ(quick->wait(milliseconds(1000)), CameraTruth::News::kSome);
  }
  EXPECT_EQ(quick->newest()->nanoseconds, 4999'000'000);
  EXPECT_EQ(idle->wait(milliseconds(1000)), CameraTruth::News::kSome);
  { const auto gone = std::move(*idle); }
  feed.tell(at(5000));
  EXPECT_EQ(quick->wait(milliseconds(1000)), CameraTruth::News::kSome);
}

TEST_F(Feed, TheEndIsHeard) {
  std::optional<CameraFeed> feed(open());
  auto truth = CameraTruth::join(path_);
  ASSERT_TRUE(truth);
  feed->tell(at(1));
  feed.reset();
  EXPECT_EQ(truth->wait(milliseconds(1000)), CameraTruth::News::kEnd);
  EXPECT_FALSE(std::filesystem::exists(path_));
  const auto none = CameraTruth::join(path_);
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::kNotFound);
}

TEST_F(Feed, ASocketThatWasLeftIsReplacedAndAnotherFeedOrFileIsNot) {
  {
    CameraFeed feed = open();
    const auto second = CameraFeed::open(path_);
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().code, ErrorCode::kRefused);
    std::filesystem::rename(path_, path_ + "-kept");
  }
  std::filesystem::rename(path_ + "-kept", path_);  // as one that was killed leaves it
  { const CameraFeed again = open(); }
  std::ofstream(path_) << "a file";
  const auto no_socket = CameraFeed::open(path_);
  ASSERT_FALSE(no_socket);
  EXPECT_TRUE(std::filesystem::is_regular_file(path_));
  std::filesystem::remove(path_);
  EXPECT_EQ(CameraFeed::open(std::string(200, 'x')).error().code, ErrorCode::kUsage);
}

}  // namespace
}  // namespace cairn
