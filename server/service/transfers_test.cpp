// SPDX-License-Identifier: Apache-2.0
#include "server/service/transfers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "common/io/test_directory.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

class TransfersTest : public ::testing::Test {
 protected:
  [[nodiscard]] size_t files() const {
    size_t count = 0;
    for (const auto& entry : std::filesystem::directory_iterator(folder_))
      count += entry.is_regular_file() ? 1 : 0;
    return count;
  }

  TestDirectory directory_;
  const std::filesystem::path& folder_ = directory_.path();
  MonotonicTime now_{1h};
};

TEST_F(TransfersTest, WhatIsWrittenInPiecesInAnyOrderIsRead) {
  Transfers transfers(folder_);
  ASSERT_TRUE(transfers.begin_import("import-1", now_));
  const std::vector<uint8_t> first{1, 2, 3};
  const std::vector<uint8_t> second{4, 5};
  ASSERT_TRUE(transfers.write("import-1", 3, second, now_));
  for (int times = 0; times < 2; ++times) ASSERT_TRUE(transfers.write("import-1", 0, first, now_));
  const auto path = transfers.find("import-1", now_);
  ASSERT_TRUE(path);
  EXPECT_EQ(std::filesystem::file_size(*path), 5U);
  EXPECT_EQ(transfers.write("import-1", Transfers::kMostBytes - 1, second, now_).error().code,
            ErrorCode::kRefused);
  transfers.end("import-1");
  EXPECT_EQ(files(), 0U);
}

TEST_F(TransfersTest, AnExportIsGoneWhenItsLastByteHasBeenRead) {
  Transfers transfers(folder_);
  const auto token = transfers.begin_export(now_);
  ASSERT_TRUE(token);
  std::ofstream(*transfers.find(*token, now_)) << "abcdefgh";
  EXPECT_EQ(transfers.read(*token, 0, 5, now_)->size(), 5U);
  EXPECT_EQ(files(), 1U);
  EXPECT_EQ(transfers.read(*token, 5, 3, now_)->size(), 3U);
  EXPECT_EQ(files(), 0U);
  EXPECT_EQ(transfers.read(*token, 8, 5, now_).error().code, ErrorCode::kNotFound);
  EXPECT_NE(*transfers.begin_export(now_), *token) << "two of one map do not meet";
}

TEST_F(TransfersTest, WhatIsLeftBehindGoesAndTooManyAreRefused) {
  Transfers transfers(folder_);
  for (size_t i = 0; i < Transfers::kMost; ++i)
    ASSERT_TRUE(transfers.begin_import("import-" + std::to_string(i), now_));
  EXPECT_EQ(transfers.begin_export(now_).error().code, ErrorCode::kRefused);
  EXPECT_TRUE(transfers.begin_import("import-0", now_)) << "the same one anew";
  now_ += Transfers::kPatience;
  ASSERT_TRUE(transfers.write("import-0", 0, {}, now_));
  EXPECT_FALSE(transfers.begin_export(now_));
  now_ += 1s;
  EXPECT_TRUE(transfers.begin_export(now_));
  EXPECT_TRUE(transfers.find("import-0", now_));
  EXPECT_EQ(files(), 1U);
}

TEST_F(TransfersTest, AFolderThatTakesNothingIsNamed) {
  Transfers transfers(folder_ / "gone");
  const Status begun = transfers.begin_import("import-1", now_);
  ASSERT_FALSE(begun);
  EXPECT_EQ(begun.error().code, ErrorCode::kIo);
  EXPECT_THAT(begun.error().message, HasSubstr(folder_.string()));
  EXPECT_EQ(transfers.begin_import("../up", now_).error().code, ErrorCode::kUsage);
}

}  // namespace
}  // namespace cairn
