// SPDX-License-Identifier: Apache-2.0
#include "common/io/trajectory.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <random>
#include <sstream>
#include <thread>

#include "common/io/test_directory.h"
#include "common/io/text.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;

MapId map_id(uint8_t n) {
  MapId id;
  id.bytes.fill(n);
  return id;
}

class TrajectoryFile : public ::testing::Test {
 protected:
  std::filesystem::path write(const std::string& content) {
    std::ofstream(path_) << content;
    return path_;
  }
  std::string written() { return *read_file(path_); }

  TestDirectory directory_;
  std::filesystem::path path_ = directory_.path() / "trajectory.txt";
};

TEST_F(TrajectoryFile, WrittenPosesReadBack) {
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  std::vector<StampedPose> poses;
  auto writer = TrajectoryWriter::open(path_);
  ASSERT_TRUE(writer) << writer.error().message;
  for (int64_t i = 0; i < 200; ++i) {
    const Eigen::Quaterniond q =
        Eigen::Quaterniond{normal(random), normal(random), normal(random), normal(random)};
    poses.push_back({Timestamp{1'305'031'098'665'900'001 + i * 33'333'333},
                     SE3(q, Eigen::Vector3d{normal(random), normal(random), normal(random)})});
    ASSERT_TRUE(writer->append(map_id(1 + i / 100), "desk", poses.back()));
  }
  ASSERT_TRUE(writer->finish());
  const auto read = read_trajectory(path_);
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->segments.size(), 2u);
  ASSERT_EQ(read->pose_count(), poses.size());
  for (size_t i = 0; i < poses.size(); ++i) {
    const auto& segment = read->segments[i / 100];
    EXPECT_EQ(segment.map, map_id(1 + i / 100));
    EXPECT_EQ(segment.map_name, "desk");
    const auto& pose = segment.poses[i % 100];
    ASSERT_EQ(pose.time, poses[i].time);
    ASSERT_LT((pose.map_from_camera.translation() - poses[i].map_from_camera.translation()).norm(), 1e-9);
    ASSERT_LT(pose.map_from_camera.rotation().angularDistance(poses[i].map_from_camera.rotation()), 1e-8);
  }
}

TEST_F(TrajectoryFile, RowsHaveExactlyEightFieldsAndAMapRowWheneverTheMapChanges) {
  auto writer = TrajectoryWriter::open(path_);
  ASSERT_TRUE(writer);
  const StampedPose pose{Timestamp{33'333'333},
                         SE3(Eigen::Quaterniond(-1, 0, 0, 0), Eigen::Vector3d(1, -2, 3))};
  for (const int map : {1, 1, 2, 1})
    ASSERT_TRUE(writer->append(map_id(map), map == 2 ? "" : "my desk", pose));
  ASSERT_TRUE(writer->finish());
  const std::string row = "0.033333333 1.000000000 -2.000000000 3.000000000 ";
  std::istringstream lines(written());
  std::vector<std::string> maps;
  int rows = 0;
  for (std::string line; std::getline(lines, line);) {
    EXPECT_FALSE(line.ends_with(' '));
    if (line.front() == '#') {
      maps.push_back(line);
      continue;
    }
    ++rows;
    EXPECT_EQ(split_fields(line).size(), 8u);
    EXPECT_EQ(std::count(line.begin(), line.end(), ' '), 7);
    EXPECT_TRUE(line.starts_with(row) && line.ends_with(" 1.000000000")) << line;
  }
  EXPECT_EQ(rows, 4);
  const std::string one = "# map 01010101010101010101010101010101 my desk";
  EXPECT_THAT(maps, ::testing::ElementsAre(one, "# map 02020202020202020202020202020202", one));
}

TEST_F(TrajectoryFile, EachRowIsInTheFileSoonAfterAppendWithoutBeingFlushed) {
  auto writer = TrajectoryWriter::open(path_);
  ASSERT_TRUE(writer);
  for (size_t n = 1; n <= 3; ++n) {
    ASSERT_TRUE(writer->append(map_id(1), "desk", {}));
    const auto rows = [this] { return std::ranges::count(written(), '\n'); };
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (rows() < static_cast<ptrdiff_t>(n) + 1 && std::chrono::steady_clock::now() < deadline)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    EXPECT_EQ(read_trajectory(path_)->pose_count(), n);
  }
}

TEST_F(TrajectoryFile, AMapNameCannotForgeRows) {
  auto writer = TrajectoryWriter::open(path_);
  ASSERT_TRUE(writer);
  ASSERT_TRUE(writer->append(map_id(1), "a\n9 9 9 9 0 0 0 1\n", {}));
  ASSERT_TRUE(writer->finish());
  const auto read = read_trajectory(path_);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->pose_count(), 1u);
}

TEST_F(TrajectoryFile, TakesTheFormsThatPeopleHave) {
  const auto read =
      read_trajectory(write("# timestamp tx ty tz qx qy qz qw\r\n\r\n,,,\n"
                            "1.5 1 2 3 0 0 0 1 \r\n2.5\t1\t2\t3\t0\t0\t0.7071\t0.7071\n"
                            "# map of nothing\n3.5,1,2,3,0,0,0,1"));
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->segments.size(), 1u);
  EXPECT_EQ(read->pose_count(), 3u);
  EXPECT_FALSE(read->segments[0].map);
  EXPECT_NEAR(read->segments[0].poses[1].map_from_camera.rotation().norm(), 1, 1e-12);
}

constexpr const char* kEurocHeading =
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], "
    "v_RS_R_x [m s^-1]\r\n";

TEST_F(TrajectoryFile, EurocAndItsKinHaveNanosecondsAndWFirst) {
  const Eigen::Quaterniond turn(0.8, 0.6, 0, 0);  // w x y z
  struct Case {
    std::string content;
    bool is_of_body;
  };
  const Case cases[] = {
      {kEurocHeading + std::string("1403636580838555648,4.688,-1.787,0.783,0.8,0.6,0,0,-0.027,0.03,1\r\n"),
       true},
      {"#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
       "1403636580838555648,4.688,-1.787,0.783,0.8,0.6,0,0\n",
       true},
      {"1403636580838555648,4.688,-1.787,0.783,0.8,0.6,0,0,-0.027,0.033,0.8,\n", true},  // VINS, no heading
      {"1403636580838555648.000000 4.688 -1.787 0.783 0.6 0 0 0.8\n", false},            // ORB-SLAM3
      {"# t tx ty tz qw qx qy qz\n1403636580.838555648 4.688 -1.787 0.783 0.8 0.6 0 0\n", false},
      {"t, p_x, p_y, p_z, q_w, q_x, q_y, q_z\n1403636580.838555648,4.688,-1.787,0.783,0.8,0.6,0,0\n", false},
      {"timestamp tx ty tz qx qy qz qw\n1403636580.838555648 4.688 -1.787 0.783 0.6 0 0 0.8\n", false}};
  for (const Case& c : cases) {
    const auto read = read_trajectory(write(c.content));
    ASSERT_TRUE(read) << read.error().message << c.content;
    ASSERT_EQ(read->pose_count(), 1u);
    EXPECT_EQ(read->is_of_body, c.is_of_body) << c.content;
    const auto& pose = read->segments[0].poses[0];
    EXPECT_EQ(pose.time.nanoseconds, 1403636580838555648) << c.content;
    EXPECT_LT((pose.map_from_camera.translation() - Eigen::Vector3d(4.688, -1.787, 0.783)).norm(), 1e-12);
    EXPECT_LT(pose.map_from_camera.rotation().angularDistance(turn), 1e-6) << c.content;
  }
  const auto from_zero =
      read_trajectory(write("#timestamp [ns],x\n0,1,2,3,1,0,0,0\n50000000,1,2,3,1,0,0,0\n"));
  ASSERT_TRUE(from_zero) << from_zero.error().message;
  EXPECT_EQ(from_zero->segments[0].poses[1].time.nanoseconds, 50'000'000);
}

TEST_F(TrajectoryFile, RowsWithoutAPoseAreLeftOutAndCounted) {
  const auto read =
      read_trajectory(write("1 1 2 3 0 0 0 1\n2 nan nan nan nan nan nan nan\n3 1 2 3 0 0 -nan 1\n4 NaN 2 3 0 "
                            "0 0 1\n5 1 2 3 0 0 0 1\n"
                            "6 inf 2 3 0 0 0 1\n7 0 0 0 0 0 0 0\n"));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->pose_count(), 2u);
  EXPECT_EQ(read->rows_left_out, 5u);
}

TEST_F(TrajectoryFile, ByteOrderMarksAndForeignLineEndsAreNoMatter) {
  for (const char* content : {"\xef\xbb\xbf# t tx\n1 1 2 3 0 0 0 1\n2 1 2 3 0 0 0 1\n",
                              "\xef\xbb\xbf"
                              "1 1 2 3 0 0 0 1\r\n2 1 2 3 0 0 0 1\r\n",
                              "timestamp tx ty tz qx qy qz qw\r1 1 2 3 0 0 0 1\r2 1 2 3 0 0 0 1\r"}) {
    const auto read = read_trajectory(write(content));
    ASSERT_TRUE(read) << read.error().message << content;
    EXPECT_EQ(read->pose_count(), 2u);
  }
  EXPECT_THAT(read_trajectory(write(std::string("\xff\xfe\x31\0", 4))).error().message,
              HasSubstr("is UTF-16"));
}

TEST_F(TrajectoryFile, ErrorsNameFileAndLine) {
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"# c\n1 2 3 4 0 0 0\n", ":2: 7 fields"},
      {"1 2 3 4 0 0 0 1 9\n", ":1: 9 fields"},
      {"x 2 3 4 0 0 0 1\n", "'x' is not a time"},
      {"1 2 3 y 0 0 0 1\n", "'y' is not a number"},
      {"1 nan 3 4 0 0 0 1\n", "no pose in it; all 1 rows have NaN or a quaternion of zeros"},
      {"1 nan 3 4 0 0 0 x\nnan 2 3 4 0 0 0 1\n", "'nan' is not a time"},
      {"1 0 0 2 0 1 0 3 0 0 1 4\n", "KITTI's poses have no times"},
      {"1403715273262142976,1,2,3,1,0,0\n", ":1: 7 fields"},
      {"1 2 3 4 0 0 0 0\n", "no pose in it; all 1 rows"},
      {"1 2 3 4 0 0 0 0.1\n", "norm"},
      {"1 2 3 4 5 6 7 8\n", "norm"},
      {"", "no pose"},
      {"# map 01010101010101010101010101010101 desk\n", "no pose"}};
  for (const auto& [content, part] : cases) {
    const auto read = read_trajectory(write(content));
    ASSERT_FALSE(read) << content;
    EXPECT_EQ(read.error().code, ErrorCode::kDamaged);
    EXPECT_THAT(read.error().message, HasSubstr("trajectory.txt"));
    EXPECT_THAT(read.error().message, HasSubstr(part));
  }
  EXPECT_EQ(read_trajectory(directory_.path() / "none").error().code, ErrorCode::kNotFound);
  EXPECT_EQ(TrajectoryWriter::open("/nowhere/t.txt").error().code, ErrorCode::kIo);
}

TEST_F(TrajectoryFile, AFullDiskIsAnError) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "no /dev/full";
  auto writer = TrajectoryWriter::open("/dev/full");
  ASSERT_TRUE(writer) << writer.error().message;
  (void)writer->append(map_id(1), "desk", {});
  const auto status = writer->finish();
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, ErrorCode::kIo);
  EXPECT_THAT(status.error().message, HasSubstr("No space left"));
}

}  // namespace
}  // namespace cairn
