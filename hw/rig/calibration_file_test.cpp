// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/calibration_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <iterator>
#include <numbers>
#include <string>

#include "common/geometry/se3.h"
#include "hw/rig/test_rig.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr double kDegree = std::numbers::pi / 180;

RigCalibration calibration() {
  RigCalibration found;
  found.head_from_camera = so3_exp(Eigen::Vector3d(1, -2, 3) * kDegree) * nominal_head_from_camera();
  found.head_from_imu = so3_exp(Eigen::Vector3d(0, 90, -0.00001) * kDegree);
  found.offset = std::chrono::microseconds(-12'340);
  return found;
}

constexpr const char* kBlock =
    "calibration:\n"
    "  camera: [1.000, -2.000, 3.000]\n"
    "  imu: [0.000, 90.000, 0.000]\n"
    "  offset: -12.34\n";

TEST(CalibrationFile, TakesThePlaceOfTheFormerOneInEachFormAndLeavesTheRestAsItWas) {
  const std::string head = "name: shoulder  # mine\n\n";
  const std::string tail = "# both alike\naxes: {}  # none\n";
  const struct {
    const char* before;
    std::string after;
  } cases[] = {
      {"", kBlock},
      {"calibration: {camera: [1, 1, 1]}\n", kBlock},
      {"calibration: {camera: [1, 1, 1],\n  offset: 3}\n", kBlock},
      {"calibration:\n  camera:\n    - 1\n    - 1\n    - 1\n", kBlock},
      {"calibration:   # how\n    camera: [1, 1, 1]  # by hand\n\n    # late\n    offset: 5 # ms\n",
       "calibration:   # how\n    camera: [1.000, -2.000, 3.000]  # by hand\n\n    # late\n    offset: "
       "-12.34 # ms\n"
       "    imu: [0.000, 90.000, 0.000]\n"},
  };
  for (const auto& each : cases)
    EXPECT_EQ(with_calibration(head + each.before + tail, calibration(), true), head + each.after + tail)
        << each.before;
  EXPECT_EQ(with_calibration(head + tail, calibration(), false),
            head + "calibration:\n  camera: [1.000, -2.000, 3.000]\n" + tail);
  EXPECT_EQ(lines_of(calibration(), true), kBlock);
}

TEST(CalibrationFile, TwiceIsAsOnce) {
  const std::string once = with_calibration(testing::kRigText, calibration(), true);
  EXPECT_EQ(with_calibration(once, calibration(), true), once);
}

class CalibrationOnDisk : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::create_directory(folder_);
    put(testing::kRigText);
  }
  void TearDown() override { fs::remove_all(folder_); }
  void put(const std::string& text) const { std::ofstream(path_) << text; }
  static std::string read(const fs::path& path) {
    std::ifstream file(path);
    return {std::istreambuf_iterator<char>(file), {}};
  }

  const fs::path folder_ =
      fs::path(::testing::TempDir()) / ("calibration_file_test_" + std::to_string(getpid()));
  const fs::path path_ = folder_ / "rig.yaml";
};

TEST_F(CalibrationOnDisk, IsReadAgainAndTheFormerFileIsKept) {
  ASSERT_EQ(chmod(path_.c_str(), 0640), 0);
  ASSERT_TRUE(check_calibration_can_be_written(path_));
  const Status written = write_calibration(path_, calibration());
  ASSERT_TRUE(written) << written.error().message;
  const auto found = read_rig_configuration(path_);
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_LT(found->calibration.head_from_camera.angularDistance(calibration().head_from_camera), 1e-4);
  EXPECT_LT(found->calibration.head_from_imu.angularDistance(calibration().head_from_imu), 1e-4);
  EXPECT_EQ(found->calibration.offset, calibration().offset);
  EXPECT_THAT(read(path_), HasSubstr("# [ms] between setpoints"));
  EXPECT_EQ(read(path_.string() + ".old"), testing::kRigText);
  EXPECT_FALSE(fs::exists(path_.string() + ".new"));
  EXPECT_EQ(fs::status(path_).permissions(), fs::perms(0640));
}

TEST_F(CalibrationOnDisk, ALinkStaysALink) {
  const fs::path link = folder_ / "link.yaml";
  fs::create_symlink(path_, link);
  ASSERT_TRUE(write_calibration(link, calibration()));
  EXPECT_TRUE(fs::is_symlink(link));
  EXPECT_THAT(read(path_), HasSubstr("offset: -12.34"));
}

TEST_F(CalibrationOnDisk, WhatCannotBeWrittenLeavesTheFileAsItWas) {
  put("name: shoulder\n");  // no rig
  EXPECT_FALSE(write_calibration(path_, calibration()));
  EXPECT_EQ(read(path_), "name: shoulder\n");
  put(testing::kRigText);
  fs::create_directory(path_.string() + ".new");  // root may write anywhere else
  const Status refused = check_calibration_can_be_written(path_);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kConfiguration);
  EXPECT_THAT(refused.error().message, HasSubstr("cannot be written"));
  EXPECT_FALSE(write_calibration(path_, calibration()));
  EXPECT_EQ(read(path_), testing::kRigText);
  // With the whole file in braces there is no line for it.
  fs::remove(path_.string() + ".new");
  put("{name: shoulder}\n");
  EXPECT_FALSE(write_calibration(path_, calibration()));
}

}  // namespace
}  // namespace cairn
