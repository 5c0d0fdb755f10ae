// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gmock/gmock.h>

#include <fstream>
#include <string>

#include "common/io/calibration.h"
#include "common/io/test_directory.h"

namespace cairn {

class Calibration : public ::testing::Test {
 protected:
  std::filesystem::path write(const std::string& content) {
    auto path = directory_.path() / "camera.txt";
    std::ofstream(path) << content;
    return path;
  }
  void expect_error(const std::string& content, const std::string& part) {
    const auto read = read_calibration(write(content));
    ASSERT_FALSE(read) << content;
    EXPECT_EQ(read.error().code, ErrorCode::kConfiguration) << read.error().message;
    EXPECT_THAT(read.error().message, ::testing::HasSubstr("camera.txt"));
    EXPECT_THAT(read.error().message, ::testing::HasSubstr(part));
  }
  TestDirectory directory_;
};

/// `text` with the first `from` in it replaced.
inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

}  // namespace cairn
