// SPDX-License-Identifier: Apache-2.0
#include "client/capture/decode_ahead.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <new>

namespace cairn {
namespace {

struct Probe {
  std::atomic<int> decoded{0};
  std::atomic<bool> destroyed{false};
};

/// Frames 0..count-1, each third an error.
class FakeSource final : public FrameSource {
 public:
  FakeSource(int count, bool live, Probe& probe) : count_(count), live_(live), probe_(probe) {}
  ~FakeSource() override { probe_.destroyed = true; }
  FakeSource(const FakeSource&) = delete;
  FakeSource& operator=(const FakeSource&) = delete;

  Result<std::optional<Frame>> next() override {
    if (next_ == count_) return std::nullopt;
    const int index = next_++;
    probe_.decoded = next_;
    if (index % 3 == 2) return fail(ErrorCode::kDamaged, "frame " + std::to_string(index));
    return Frame{static_cast<uint64_t>(index), Timestamp{index * 100},
                 std::make_shared<const GrayImage>(8, 8)};
  }
  std::optional<size_t> frame_count() const override { return static_cast<size_t>(count_); }
  std::optional<CameraParameters> builtin_calibration() const override {
    return CameraParameters{CameraModel::kPinholeRadtan, 8, 8, {1, 2, 3, 4}};
  }
  std::string describe() const override { return "fake"; }
  bool is_live() const override { return live_; }

 private:
  int count_;
  bool live_;
  Probe& probe_;
  int next_ = 0;
};

/// Polls with a deadline that only a broken program meets.
template <typename Condition>
bool eventually(Condition condition) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

std::unique_ptr<FrameSource> fake(Probe& probe, int count, bool live) {
  return std::make_unique<FakeSource>(count, live, probe);
}

TEST(DecodeAhead, GivesFramesAndErrorsInOrderThenTheEndForEver) {
  Probe probe;
  DecodeAhead ahead(fake(probe, 50, false), 4);
  for (int i = 0; i < 50; ++i) {
    const auto item = ahead.next();
    ASSERT_EQ(item.has_value(), i % 3 != 2) << i;
    if (item) {
      ASSERT_TRUE(item->has_value());
      EXPECT_EQ((*item)->index, static_cast<uint64_t>(i));
    } else {
      EXPECT_EQ(item.error().message, "frame " + std::to_string(i));
    }
  }
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(ahead.next()->has_value());
}

/// No memory for its second image, say.
struct ThrowsOnce final : FrameSource {
  Result<std::optional<Frame>> next() override {
    const uint64_t index = taken++;
    if (index == 1) throw std::bad_alloc();
    if (index == 3) return std::nullopt;
    return Frame{index, Timestamp{static_cast<int64_t>(index)}, std::make_shared<const GrayImage>(8, 8)};
  }
  std::optional<size_t> frame_count() const override { return 3; }
  std::optional<CameraParameters> builtin_calibration() const override { return std::nullopt; }
  std::string describe() const override { return "video.mp4"; }
  bool is_live() const override { return false; }
  uint64_t taken = 0;
};

TEST(DecodeAhead, WhatTheSourceThrowsIsAFrameThatCannotBeRead) {
  DecodeAhead ahead(std::make_unique<ThrowsOnce>());
  EXPECT_EQ(ahead.next().value()->index, 0U);
  const auto thrown = ahead.next();
  ASSERT_FALSE(thrown);
  EXPECT_EQ(thrown.error().code, ErrorCode::kDamaged);
  EXPECT_TRUE(thrown.error().message.starts_with("video.mp4: ")) << thrown.error().message;
  EXPECT_EQ(ahead.next().value()->index, 2U) << "the next is read";
  EXPECT_FALSE(ahead.next().value());
}

TEST(DecodeAhead, KeepsAtMostTheQueueAhead) {
  Probe probe;
  DecodeAhead ahead(fake(probe, 1000, false), 5);
  ASSERT_TRUE(eventually([&] { return probe.decoded == 5; }));
  for (int taken = 1; taken <= 20; ++taken) {
    (void)ahead.next();
    ASSERT_TRUE(eventually([&] { return probe.decoded == 5 + taken; }));
    ASSERT_LE(probe.decoded, 5 + taken);
  }
}

TEST(DecodeAhead, ALiveSourceKeepsOnlyItsNewest) {
  Probe probe;
  DecodeAhead ahead(fake(probe, 101, true), 30);
  ASSERT_TRUE(eventually([&] { return probe.decoded == 101; }));
  // The thread may still be queueing the last frame: take until the end, what comes is ascending and ends
  // with the last.
  std::optional<uint64_t> last;
  while (true) {
    const auto item = ahead.next();
    if (item && !item->has_value()) break;
    if (item) {
      EXPECT_TRUE(!last || (*item)->index > *last);
      EXPECT_GE((*item)->index, 98u);
      last = (*item)->index;
    }
  }
  EXPECT_EQ(last, 100u);
}

TEST(DecodeAhead, SaysOfItselfWhatTheSourceSays) {
  Probe probe;
  const DecodeAhead ahead(fake(probe, 7, true));
  EXPECT_EQ(ahead.frame_count(), 7u);
  EXPECT_EQ(ahead.describe(), "fake");
  EXPECT_TRUE(ahead.is_live());
  EXPECT_EQ(ahead.builtin_calibration()->values.size(), 4u);
}

TEST(DecodeAhead, EndsWithFramesLeft) {
  Probe probe;
  { const DecodeAhead ahead(fake(probe, 1'000'000, false), 3); }
  EXPECT_TRUE(probe.destroyed);
  EXPECT_LT(probe.decoded, 1'000'000);
}

}  // namespace
}  // namespace cairn
