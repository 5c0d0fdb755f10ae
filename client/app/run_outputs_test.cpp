// SPDX-License-Identifier: Apache-2.0
#include "client/app/run_outputs.h"

#include <gmock/gmock.h>
#include <spdlog/sinks/ostream_sink.h>
#include <sys/stat.h>

#include <chrono>
#include <fstream>
#include <sstream>
#include <thread>

#include "client/app/test_doubles.h"
#include "common/io/test_directory.h"
#include "common/io/text.h"

namespace cairn {
namespace {

using ::testing::AllOf;
using testing::at_ms;
using ::testing::HasSubstr;
using testing::make_frame;

class RunOutputsTest : public ::testing::Test {
 protected:
  RunOutputsTest() {
    options_.source =
        "video:" + (folder_ / "clip.mp4").string() + "?times=" + (folder_ / "times.txt").string();
    for (const char* name : {"clip.mp4", "times.txt", "camera.txt", "labels.txt", "settings.yaml"})
      std::ofstream(folder_ / name) << name;
    mkfifo((folder_ / "pipe").c_str(), 0600);
    mkfifo((folder_ / "pipe.mkv").c_str(), 0600);
  }
  [[nodiscard]] Status check() const {
    return check_outputs(options_, folder_ / "camera.txt#cam1", calibration_to_save_);
  }
  void track_a_frame(const std::vector<FrameObserver*>& observers) {
    const Frame frame = make_frame(0, at_ms(0));
    FrameResult result;
    result.map = MapId{{1}};
    const MapSnapshotPtr snapshot;
    const LabelListPtr labels;
    const SessionStatus status;
    const StageTimes stages{};
    for (FrameObserver* observer : observers)
      observer->on_frame(
          {0, frame, result, FrameState::kTracking, snapshot, labels, status, stages, {}, {}, nullptr});
  }

  TestDirectory directory_;
  const std::filesystem::path folder_ = directory_.path();
  TrackOptions options_;
  std::optional<std::filesystem::path> calibration_to_save_;
};

TEST_F(RunOutputsTest, NoOutputIsAnotherOneOrWhatIsRead) {
  options_.labels = folder_ / "labels.txt";
  options_.config = folder_ / "settings.yaml";
  for (const char* name : {"clip.mp4", "times.txt", "camera.txt", "labels.txt", "settings.yaml"}) {
    options_.trajectory = folder_ / "." / name;
    const auto status = check();
    ASSERT_FALSE(status) << name;
    EXPECT_EQ(status.error().code, ErrorCode::kUsage);
    EXPECT_THAT(status.error().message, HasSubstr("--trajectory"));
    EXPECT_EQ(*read_file(folder_ / name), name);  // untouched
  }
  options_.trajectory = folder_ / "out";
  EXPECT_TRUE(check());
  options_.stats = folder_ / "." / "out";
  EXPECT_FALSE(check());
  options_.stats = folder_ / "stats";
  calibration_to_save_ = folder_ / "stats";
  EXPECT_FALSE(check());
  options_.trajectory = options_.stats = "/dev/null";
  EXPECT_TRUE(check());
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out"));
}

TEST_F(RunOutputsTest, ACameraCalibratedUnderItsOwnNameMayImproveWhatWasRead) {
  calibration_to_save_ = folder_ / "camera.txt";
  EXPECT_TRUE(check());
  options_.saved_calibration = folder_ / "camera.txt";
  EXPECT_FALSE(check());
}

TEST_F(RunOutputsTest, AVideoIntoAPipeIsRefusedWithoutWaiting) {
  options_.video = folder_ / "pipe.mkv";
  const auto status = check();
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, ErrorCode::kUsage);
  EXPECT_THAT(status.error().message, HasSubstr("pipe"));
}

TEST_F(RunOutputsTest, PipesThatNobodyReadsCostNothingAndAreToldOnceEach) {
  options_.trajectory = folder_ / "pipe";
  EXPECT_TRUE(check());
  auto outputs = RunOutputs::open(
      options_, nullptr, [] { return false; }, null_logger());
  ASSERT_TRUE(outputs) << outputs.error().message;
  track_a_frame(outputs->observers());
  const auto closed = outputs->close(RunStats(RunStats::FrameList::kKept), 0, 0);
  ASSERT_FALSE(closed);
  EXPECT_EQ(closed.error().code, ErrorCode::kIo);
  EXPECT_THAT(closed.error().message, HasSubstr("nobody reads"));
}

/// /dev/full is a disk without room.
class FullDiskTest : public RunOutputsTest {
 protected:
  FullDiskTest() {
    for (const char* name : {"poses.txt", "stats.json"})
      std::filesystem::create_symlink("/dev/full", folder_ / name);
  }
  Result<RunOutputs> open() {
    return RunOutputs::open(
        options_, nullptr, [] { return false; }, log_);
  }

  std::ostringstream said_;
  Logger log_ =
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(said_));
};

TEST_F(FullDiskTest, APoseThatCannotBeWrittenIsToldAtOnceAndOnceAndAtTheEnd) {
  options_.trajectory = folder_ / "poses.txt";
  auto outputs = open();
  ASSERT_TRUE(outputs) << outputs.error().message;
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (said_.str().empty() && std::chrono::steady_clock::now() < deadline) {
    track_a_frame(outputs->observers());
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  const std::string at_once = said_.str();
  EXPECT_THAT(at_once, AllOf(HasSubstr("poses.txt"), HasSubstr("No space left"), HasSubstr("going on")));
  for (int i = 0; i < 20; ++i) track_a_frame(outputs->observers());
  EXPECT_EQ(said_.str(), at_once);
  const auto closed = outputs->close(RunStats(RunStats::FrameList::kKept), 0, 0);
  ASSERT_FALSE(closed);
  EXPECT_EQ(closed.error().code, ErrorCode::kIo);
  EXPECT_THAT(closed.error().message,
              AllOf(HasSubstr("poses.txt"), HasSubstr("No space left"), HasSubstr("rows are missing")));
}

TEST_F(FullDiskTest, EachFileThatIsNotWholeIsToldByName) {
  options_.trajectory = folder_ / "poses.txt";
  options_.stats = folder_ / "stats.json";
  auto outputs = open();
  ASSERT_TRUE(outputs) << outputs.error().message;
  track_a_frame(outputs->observers());
  const auto closed = outputs->close(RunStats(RunStats::FrameList::kKept), 0, 0);
  ASSERT_FALSE(closed);
  EXPECT_EQ(closed.error().code, ErrorCode::kIo);
  const std::string all = said_.str() + closed.error().message;
  for (const char* name : {"poses.txt", "stats.json"})
    EXPECT_THAT(all, HasSubstr(std::string(name) + ": cannot be written: No space left")) << name;
}

TEST_F(RunOutputsTest, FilesAreCompleteWhenTheyAreClosed) {
  options_.trajectory = folder_ / "out";
  options_.stats = folder_ / "stats";
  std::ofstream(folder_ / "stats") << "of an earlier run";
  EXPECT_TRUE(check());
  EXPECT_EQ(*read_file(folder_ / "stats"), "of an earlier run");
  auto outputs = RunOutputs::open(
      options_, nullptr, [] { return false; }, null_logger());
  ASSERT_TRUE(outputs);
  track_a_frame(outputs->observers());
  const RunStats stats(RunStats::FrameList::kKept);
  ASSERT_TRUE(outputs->close(stats, 1, 2));
  EXPECT_EQ(*read_file(folder_ / "stats"), stats.to_json(1, 2));
  EXPECT_EQ(read_trajectory(folder_ / "out")->pose_count(), 1U);
}

}  // namespace
}  // namespace cairn
