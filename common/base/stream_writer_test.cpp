// SPDX-License-Identifier: Apache-2.0
#include "common/base/stream_writer.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <fstream>
#include <sstream>

#include "common/base/test_pipe.h"
#include "common/io/test_directory.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;
using ::testing::HasSubstr;

constexpr DrainPatience kShort{milliseconds(50), milliseconds(200)};
constexpr size_t kRowBytes = 100;

std::string row(size_t number) {
  std::string text = std::to_string(number);
  text.resize(kRowBytes - 1, '.');
  return text + '\n';
}

std::string content_of(const std::filesystem::path& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

class StreamWriterTest : public ::testing::Test {
 protected:
  StreamWriterTest() { std::signal(SIGPIPE, SIG_DFL); }
  std::filesystem::path make_pipe() {
    EXPECT_EQ(mkfifo(path_.c_str(), 0600), 0);
    return path_;
  }

  TestDirectory directory_;
  const std::filesystem::path path_ = directory_.path() / "out";
};

TEST_F(StreamWriterTest, AFileIsCompleteAndInOrderHoweverFastRowsCome) {
  std::ofstream(path_) << "an earlier run";
  auto writer = StreamWriter::open(path_);
  ASSERT_TRUE(writer) << writer.error().message;
  std::string all;
  for (size_t i = 0; i < 2000; ++i) {
    all += row(i);
    ASSERT_TRUE((*writer)->write(row(i)));
  }
  const auto status = (*writer)->finish({milliseconds(0), milliseconds(0)});  // a file is not given up
  EXPECT_TRUE(status) << status.error().message;
  EXPECT_EQ(content_of(path_), all);
}

TEST_F(StreamWriterTest, APipeWithoutAReaderHoldsNobodyUpAndIsTold) {
  auto writer = StreamWriter::open(make_pipe());
  ASSERT_TRUE(writer) << writer.error().message;
  EXPECT_TRUE((*writer)->write(row(0)));
  const auto status = (*writer)->finish(kShort);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, ErrorCode::kIo);
  EXPECT_THAT(status.error().message, HasSubstr("nobody reads"));
}

TEST_F(StreamWriterTest, AReaderThatComesLateGetsAll) {
  auto writer = StreamWriter::open(make_pipe());
  ASSERT_TRUE(writer);
  EXPECT_TRUE((*writer)->write(row(0)));
  const int reader = open(path_.c_str(), O_RDONLY | O_NONBLOCK);
  ASSERT_GE(reader, 0);
  EXPECT_TRUE((*writer)->write(row(1)));
  const auto status = (*writer)->finish();
  EXPECT_TRUE(status) << status.error().message;
  EXPECT_EQ(drained(reader), row(0) + row(1));
  close(reader);
}

TEST_F(StreamWriterTest, WhatAReaderThatHangsDoesNotTakeIsLeftOutInWholeRows) {
  const int reader = open(make_pipe().c_str(), O_RDONLY | O_NONBLOCK);
  auto writer = StreamWriter::open(path_, 10 * kRowBytes);
  ASSERT_TRUE(writer);
  size_t left_out = 0;
  for (size_t i = 0; i < 3000; ++i) left_out += (*writer)->write(row(i)) ? 0 : 1;  // a pipe holds 64 kB
  EXPECT_GT(left_out, 1000U);
  EXPECT_FALSE((*writer)->status());
  const auto status = (*writer)->finish(kShort);
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, HasSubstr("of 3000 rows are missing"));
  const std::string text = drained(reader);
  EXPECT_EQ(text.size() % kRowBytes, 0U);
  EXPECT_TRUE(text.starts_with(row(0) + row(1)));
  close(reader);
}

TEST_F(StreamWriterTest, ARowLongerThanAPipeReachesASlowReader) {
  const int reader = open(make_pipe().c_str(), O_RDONLY | O_NONBLOCK);
  auto writer = StreamWriter::open(path_, kRowBytes);
  ASSERT_TRUE(writer);
  const std::string long_row(300'000, 'x');
  ASSERT_TRUE((*writer)->write(long_row));
  std::string text;
  std::thread slow([&] {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (text.size() < long_row.size() && std::chrono::steady_clock::now() < deadline) {
      text += drained(reader);
      std::this_thread::sleep_for(milliseconds(1));
    }
  });
  const auto status = (*writer)->finish({milliseconds(60'000), milliseconds(60'000)});
  slow.join();
  EXPECT_TRUE(status) << status.error().message;
  EXPECT_EQ(text, long_row);
  close(reader);
}

TEST_F(StreamWriterTest, AReaderThatHasGoneIsAnErrorOfTheWriteAndNotTheEnd) {
  const int reader = open(make_pipe().c_str(), O_RDONLY | O_NONBLOCK);
  auto writer = StreamWriter::open(path_);
  ASSERT_TRUE(writer);
  close(reader);
  EXPECT_TRUE((*writer)->write(row(0)));
  const auto status = (*writer)->finish();
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, HasSubstr("Broken pipe"));
}

TEST_F(StreamWriterTest, ARequestToStopEndsTheWaitingForAReader) {
  auto writer = StreamWriter::open(make_pipe());
  ASSERT_TRUE(writer);
  EXPECT_TRUE((*writer)->write(row(0)));
  int asked = 0;
  const DrainPatience forever{std::chrono::hours(1), std::chrono::hours(1)};
  EXPECT_FALSE((*writer)->finish(forever, [&asked] { return ++asked > 2; }));
}

/// A limit of the file's size stands for a full disk that somebody makes room on.
TEST_F(StreamWriterTest, WhatAFullDiskRefusedIsWrittenOnceThereIsRoom) {
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const rlimit small{kRowBytes + 10, before.rlim_max};
  auto writer = StreamWriter::open(path_);
  ASSERT_TRUE(writer);
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
  for (size_t i = 0; i < 3; ++i) EXPECT_TRUE((*writer)->write(row(i)));
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while ((*writer)->status() && std::chrono::steady_clock::now() < deadline)
    std::this_thread::sleep_for(milliseconds(1));
  EXPECT_FALSE((*writer)->status());
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
  const auto status = (*writer)->finish();
  EXPECT_TRUE(status) << status.error().message;
  EXPECT_EQ(content_of(path_), row(0) + row(1) + row(2));
}

TEST_F(StreamWriterTest, AStreamOfTheProcessNeverWaitsAndKeepsItsFlags) {
  std::array<int, 2> pipe_ends{};
  ASSERT_EQ(pipe(pipe_ends.data()), 0);
  std::array<int, 2> socket_ends{};
  ASSERT_EQ(socketpair(AF_UNIX, SOCK_STREAM, 0, socket_ends.data()), 0);
  for (const auto& [to, from] :
       {std::pair(pipe_ends[1], pipe_ends[0]), std::pair(socket_ends[1], socket_ends[0])}) {
    auto writer = StreamWriter::of_descriptor(to, "log", 10 * kRowBytes);
    EXPECT_TRUE(writer->write(row(0)));
    std::string first(kRowBytes, '\0');
    EXPECT_EQ(read(from, first.data(), first.size()),
              static_cast<ssize_t>(kRowBytes));  // it is there at once
    EXPECT_EQ(first, row(0));
    size_t left_out = 0;
    for (size_t i = 0; i < 20'000; ++i) left_out += writer->write(row(i)) ? 0 : 1;
    EXPECT_GT(left_out, 0U);
    EXPECT_FALSE(writer->finish(kShort));
    EXPECT_EQ(fcntl(to, F_GETFL) & O_NONBLOCK, 0);
    close(to);
    close(from);
  }
}

TEST_F(StreamWriterTest, AFileOfTheProcessIsGoneOnWith) {
  std::ofstream(path_) << "before ";
  const int file = open(path_.c_str(), O_WRONLY | O_APPEND);
  {
    auto writer = StreamWriter::of_descriptor(file, "log");
    EXPECT_TRUE(writer->write("first "));
    EXPECT_EQ(content_of(path_), "before first ");  // without finish()
    auto same = StreamWriter::open("/proc/self/fd/" + std::to_string(file));
    ASSERT_TRUE(same);
    EXPECT_TRUE((*same)->write("second"));
    EXPECT_TRUE((*same)->finish());
  }
  EXPECT_EQ(content_of(path_), "before first second");
  close(file);
}

TEST_F(StreamWriterTest, AStreamThatIsClosedTakesNothing) {
  auto writer = StreamWriter::of_descriptor(-1, path_.string());
  EXPECT_FALSE(writer->write("a row"));
  EXPECT_FALSE(writer->finish());
  EXPECT_FALSE(std::filesystem::exists(path_));  // a name is no path
}

TEST_F(StreamWriterTest, WhatCannotBeOpenedIsToldWithItsReason) {
  const auto writer = StreamWriter::open(directory_.path() / "no" / "file");
  ASSERT_FALSE(writer);
  EXPECT_EQ(writer.error().code, ErrorCode::kIo);
  EXPECT_THAT(writer.error().message, HasSubstr("No such file"));
}

}  // namespace
}  // namespace cairn
