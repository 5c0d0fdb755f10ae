// SPDX-License-Identifier: Apache-2.0
#include "common/base/log.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <unistd.h>

#include <array>
#include <string>

#include "common/base/test_pipe.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

class LogToAPipe : public ::testing::Test {
 protected:
  LogToAPipe() {
    std::array<int, 2> ends{};
    EXPECT_EQ(pipe(ends.data()), 0);
    from_ = ends[0];
    to_ = ends[1];
    fcntl(from_, F_SETFL, O_NONBLOCK);
  }
  ~LogToAPipe() override {
    close(from_);
    close(to_);
  }
  LogToAPipe(const LogToAPipe&) = delete;
  LogToAPipe& operator=(const LogToAPipe&) = delete;

  int from_ = -1;
  int to_ = -1;
};

TEST_F(LogToAPipe, ALineIsThereAtOnceAndWithoutColour) {
  const auto log = make_logger("name", 0, to_);
  log->info("a word");
  const std::string text = drained(from_);
  EXPECT_THAT(text, HasSubstr("name: info a word\n"));
  EXPECT_EQ(text.find('\x1b'), std::string::npos);
}

TEST_F(LogToAPipe, LinesThatNobodyReadsAreLeftOutAndCounted) {
  const auto log = make_logger("name", 0, to_);
  const std::string long_line(1000, '.');
  for (int i = 0; i < 1000; ++i) log->info("{} {}", i, long_line);  // more than pipe and queue hold
  std::string text;
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (text.find("left out") == std::string::npos && std::chrono::steady_clock::now() < deadline) {
    text += drained(from_);
    log->info("more");
  }
  EXPECT_THAT(text, HasSubstr("info 0 ..."));
  EXPECT_THAT(text, HasSubstr(" lines of the log left out: nobody read them\n"));
}

}  // namespace
}  // namespace cairn
