// SPDX-License-Identifier: Apache-2.0
#include "common/io/calibration.h"

#include <gmock/gmock.h>

#include <fstream>
#include <opencv2/core.hpp>
#include <random>

#include "common/io/test_directory.h"

namespace cairn {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class Calibration : public testing::Test {
 protected:
  std::filesystem::path write(const std::string& content) {
    const auto path = directory_.path() / "camera.txt";
    std::ofstream(path) << content;
    return path;
  }
  void expect_error(const std::string& content, const std::string& part) {
    const auto read = read_calibration(write(content));
    ASSERT_FALSE(read) << content;
    EXPECT_EQ(read.error().code, ErrorCode::kConfiguration) << read.error().message;
    EXPECT_THAT(read.error().message, HasSubstr("camera.txt"));
    EXPECT_THAT(read.error().message, HasSubstr(part));
  }
  TestDirectory directory_;
};

TEST_F(Calibration, OneLineWithAndWithoutDistortion) {
  const auto plain = read_calibration(write("# a comment\n640 480 525 526 320.5 240 \n"));
  ASSERT_TRUE(plain) << plain.error().message;
  EXPECT_EQ(plain->width, 640);
  EXPECT_EQ(plain->height, 480);
  EXPECT_THAT(plain->values, ElementsAre(525, 526, 320.5, 240, 0, 0, 0, 0, 0));
  const auto four = read_calibration(write("752 480 458 457 367 248 -0.28 0.07 1e-4 2e-5 # EuRoC\r\n"));
  ASSERT_TRUE(four) << four.error().message;
  EXPECT_THAT(four->values, ElementsAre(458, 457, 367, 248, -0.28, 0.07, 1e-4, 2e-5, 0));
  const auto five = read_calibration(write("752 480 458 457 367 248 -0.28 0.07 1e-4 2e-5 0.01"));
  ASSERT_TRUE(five) << five.error().message;
  EXPECT_EQ(five->values[8], 0.01);
}

TEST_F(Calibration, WrittenValuesReadBackEqual) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (int i = 0; i < 50; ++i) {
    CameraParameters parameters{CameraModel::kPinholeRadtan, 640, 480, {}};
    parameters.values = {500 + unit(random),  500 + unit(random),  320 + unit(random),
                         240 + unit(random),  0.01 * unit(random), 1e-3 * unit(random),
                         1e-4 * unit(random), 1e-4 * unit(random), 1e-5 * unit(random)};
    const auto path = directory_.path() / "written.txt";
    ASSERT_TRUE(write_calibration_txt(path, parameters, "made by a test\nof two lines"));
    const auto back = read_calibration(path);
    ASSERT_TRUE(back) << back.error().message;
    ASSERT_EQ(*back, parameters);
  }
  EXPECT_EQ(write_calibration_txt("/nowhere/camera.txt", {}).error().code, ErrorCode::kIo);
}

TEST_F(Calibration, OpenCvWritesWhatWeRead) {
  for (const int count : {4, 5, 8}) {
    const auto path = (directory_.path() / "camera.yaml").string();
    {
      cv::FileStorage file(path, cv::FileStorage::WRITE);
      file << "image_width" << 640 << "image_height" << 480;
      file << "camera_matrix"
           << (cv::Mat)(cv::Mat_<double>(3, 3) << 517.3, 0, 318.6, 0, 516.5, 255.3, 0, 0, 1);
      cv::Mat distortion = cv::Mat::zeros(count, 1, CV_64F);
      distortion.at<double>(0) = -0.1;
      distortion.at<double>(3) = 0.0026;
      file << "distortion_coefficients" << distortion;
    }
    const auto read = read_calibration(path);
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(read->width, 640);
    EXPECT_THAT(read->values, ElementsAre(517.3, 516.5, 318.6, 255.3, -0.1, 0, 0, 0.0026, 0)) << count;
  }
}

constexpr const char* kRosYaml = R"(image_width: 640
image_height: 480
camera_name: head
camera_matrix: {rows: 3, cols: 3, data: [500, 0, 320, 0, 500, 240, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0, 0, 0, 0]}
)";

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST_F(Calibration, RosCameraInfo) {
  const auto read = read_calibration(write(kRosYaml));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_THAT(read->values, ElementsAre(500, 500, 320, 240, 0.1, 0, 0, 0, 0));
}

TEST_F(Calibration, YamlErrorsNameTheLine) {
  expect_error(replaced(kRosYaml, "plumb_bob", "equidistant"), ":5: distortion_model 'equidistant'");
  expect_error(replaced(kRosYaml, "image_width: 640", "image_width: wide"), ":1: image_width");
  expect_error(replaced(kRosYaml, "image_height: 480\n", ""), "image_height");
  expect_error(replaced(kRosYaml, "[500, 0, 320", "[500, 3, 320"), ":4: camera_matrix");
  expect_error(replaced(kRosYaml, "0, 0, 1]", "0, 0]"), ":4: camera_matrix");
  expect_error(replaced(kRosYaml, "0.1, 0, 0, 0, 0", "0.1, 0, 0, 0, 0, 0, 2"), ":6: more than 5");
  expect_error(replaced(kRosYaml, "data: [0.1", "dota: [0.1"), ":6: distortion_coefficients");
  expect_error("%YAML:1.0\n---\na: [1, 2\nb: }", "not YAML");
  expect_error("camera: 1\n", "image_width");
}

TEST_F(Calibration, OneLineErrorsNameTheLine) {
  expect_error("", "no calibration");
  expect_error("# only talk\n", "no calibration");
  expect_error("# x\n640 480 525 525 320\n", ":2: 5 numbers");
  expect_error("640 480 525 525 320 240 0.1\n", "7 numbers");
  expect_error("640 480 525 525 320 abc\n", "'abc' is not a number");
  expect_error("640 480 525 525 320 nan\n", "'nan' is not a number");
  expect_error("640 480 525 525 320 240\n640 480 525 525 320 240\n", ":2: a second line");
  expect_error("640.5 480 525 525 320 240\n", "whole numbers");
  expect_error("0 480 525 525 320 240\n", "whole numbers");
  expect_error("640 480 -525 525 320 240\n", "camera.txt: ");
}

TEST_F(Calibration, MissingFileSaysWhatToDo) {
  const auto read = read_calibration(directory_.path() / "none.txt");
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(read.error().message, HasSubstr("--calibration"));
}

}  // namespace
}  // namespace cairn
