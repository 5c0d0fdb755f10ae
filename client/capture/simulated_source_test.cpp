// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include <cstring>

#include "client/capture/frame_source.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;

std::unique_ptr<FrameSource> open(const std::string& uri) {
  auto source = open_source(uri);
  EXPECT_TRUE(source) << source.error().message;
  return source ? std::move(*source) : nullptr;
}

Frame take(FrameSource& source) {
  auto item = source.next();
  EXPECT_TRUE(item && *item);
  return item && *item ? **item : Frame{};
}

bool same_pixels(const GrayImage& a, const GrayImage& b) {
  if (a.width() != b.width() || a.height() != b.height()) return false;
  for (int y = 0; y < a.height(); ++y) {
    if (std::memcmp(a.row(y), b.row(y), static_cast<size_t>(a.width())) != 0) return false;
  }
  return true;
}

TEST(SimulatedSource, SameUriSameBytesOtherSeedOther) {
  const auto a = open("sim:desk?seed=3&camera=hand&frames=2");
  const auto b = open("sim:desk?seed=3&frames=2");
  const auto c = open("sim:desk?seed=4&frames=2");
  ASSERT_TRUE(a && b && c);
  EXPECT_EQ(a->frame_count(), 2u);
  EXPECT_FALSE(a->is_live());
  for (uint64_t i = 0; i < 2; ++i) {
    const Frame frame_a = take(*a);
    const Frame frame_b = take(*b);
    EXPECT_EQ(frame_a.index, i);
    EXPECT_EQ(frame_a.time, frame_b.time);
    ASSERT_TRUE(frame_a.image && frame_b.image);
    EXPECT_TRUE(same_pixels(*frame_a.image, *frame_b.image));
    EXPECT_FALSE(same_pixels(*frame_a.image, *take(*c).image));
  }
  EXPECT_FALSE(a->next()->has_value());
}

TEST(SimulatedSource, KnowsItsCalibration) {
  const auto source = open("sim:desk?frames=1");
  ASSERT_TRUE(source);
  const auto calibration = source->builtin_calibration();
  ASSERT_TRUE(calibration);
  EXPECT_TRUE(make_camera(*calibration));
  const Frame frame = take(*source);
  EXPECT_EQ(frame.image->width(), calibration->width);
  EXPECT_EQ(frame.image->height(), calibration->height);
}

TEST(SimulatedSource, ErrorsNameWhatThereIs) {
  const auto scenario = open_source("sim:moonbase");
  ASSERT_FALSE(scenario);
  EXPECT_THAT(scenario.error().message, HasSubstr("desk"));
  const auto option = open_source("sim:desk?sped=2");
  ASSERT_FALSE(option);
  EXPECT_EQ(option.error().code, ErrorCode::kUsage);
  EXPECT_THAT(option.error().message, HasSubstr("speed"));
  EXPECT_FALSE(open_source("sim:desk?seed=x"));
}

}  // namespace
}  // namespace cairn
