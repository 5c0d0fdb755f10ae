// SPDX-License-Identifier: Apache-2.0
#include "common/io/calibration.h"

#include <gmock/gmock.h>

#include <fstream>
#include <opencv2/core.hpp>
#include <random>

#include "common/io/calibration_fixture.h"

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

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

TEST_F(Calibration, RosCameraInfo) {
  const auto read = read_calibration(write(kRosYaml));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_THAT(read->values, ElementsAre(500, 500, 320, 240, 0.1, 0, 0, 0, 0));
}

TEST_F(Calibration, RosFisheyeIsKannalaBrandt) {
  auto yaml = replaced(kRosYaml, "data: [0.1, 0, 0, 0, 0]", "data: [0.1, -0.02, 0.003, 4e-4]");
  for (const char* name : {"equidistant", "fisheye"}) {
    for (const char* tail : {"", ", 0", ", 0.0, 0"}) {  // some drivers keep the plumb bob's fifth place
      const auto read = read_calibration(
          write(replaced(replaced(yaml, "plumb_bob", name), "4e-4", std::string("4e-4") + tail)));
      ASSERT_TRUE(read) << read.error().message;
      EXPECT_EQ(read->model, CameraModel::kKannalaBrandt);
      EXPECT_THAT(read->values, ElementsAre(500, 500, 320, 240, 0.1, -0.02, 0.003, 4e-4));
    }
  }
}

TEST_F(Calibration, RosRationalIsReadWhenItsDenominatorIsOne) {
  const auto rational = replaced(kRosYaml, "plumb_bob", "rational_polynomial");
  const auto read =
      read_calibration(write(replaced(rational, "[0.1, 0, 0, 0, 0]", "[0.1, 0.2, 0, 0, 0.3, 0, 0, 0]")));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_THAT(read->values, ElementsAre(500, 500, 320, 240, 0.1, 0.2, 0, 0, 0.3));
  expect_error(replaced(rational, "[0.1, 0, 0, 0, 0]", "[0.1, 0.2, 0, 0, 0.3, 0, 0.1, 0]"),
               ":6: more than 5 distortion coefficients");
}

/// As Kalibr writes it (camchain-*.yaml), with the second camera of the chain.
constexpr const char* kCamchain = R"(cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.0012, 0.0034, -0.0056, 0.0078]
  distortion_model: equidistant
  intrinsics: [190.97, 190.98, 254.93, 256.89]
  resolution: [512, 513]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, 0.1]
  camera_model: pinhole
  distortion_coeffs: [0, 0, 0, 0]
  distortion_model: radtan
  intrinsics: [500, 501, 320, 240]
  resolution: [640, 480]
)";

TEST_F(Calibration, OfACamchainOneIsNamed) {
  const auto second = read_calibration(write(kCamchain).string() + "#cam1");
  ASSERT_TRUE(second) << second.error().message;
  EXPECT_THAT(second->values, ElementsAre(500, 501, 320, 240, 0, 0, 0, 0, 0));
  expect_error(kCamchain, "cam0, cam1; say which");
  EXPECT_THAT(read_calibration(directory_.path() / "camera.txt#cam7").error().message,
              HasSubstr("cam0, cam1; say which"));
  const std::string alone = std::string(kCamchain).substr(std::string(kCamchain).find("cam1:"));
  const auto only = read_calibration(write(alone));
  ASSERT_TRUE(only) << only.error().message;
  EXPECT_EQ(only->values, second->values);
  write("640 480 525 525 320 240\n");
  EXPECT_THAT(read_calibration(directory_.path() / "camera.txt#cam0").error().message,
              HasSubstr("only the files of Kalibr"));
  const auto odd = directory_.path() / "desk#cam1";  // a name like any other
  std::ofstream(odd) << "640 480 525 525 320 240\n";
  EXPECT_TRUE(read_calibration(odd));
}

TEST_F(Calibration, KalibrGivesItsCamera) {
  const auto equidistant = read_calibration(write(kCamchain).string() + "#cam0");
  ASSERT_TRUE(equidistant) << equidistant.error().message;
  EXPECT_EQ(equidistant->model, CameraModel::kKannalaBrandt);
  EXPECT_EQ(equidistant->width, 512);
  EXPECT_EQ(equidistant->height, 513);
  EXPECT_THAT(equidistant->values,
              ElementsAre(190.97, 190.98, 254.93, 256.89, -0.0012, 0.0034, -0.0056, 0.0078));
  const auto radtan =
      read_calibration(write(replaced(kCamchain, "equidistant", "radtan")).string() + "#cam0");
  ASSERT_TRUE(radtan) << radtan.error().message;
  EXPECT_EQ(radtan->model, CameraModel::kPinholeRadtan);
  EXPECT_THAT(radtan->values,
              ElementsAre(190.97, 190.98, 254.93, 256.89, -0.0012, 0.0034, -0.0056, 0.0078, 0));
  const auto none = read_calibration(
      write(replaced(replaced(kCamchain, "equidistant", "none"), "[-0.0012, 0.0034, -0.0056, 0.0078]", "[]"))
          .string() +
      "#cam0");
  ASSERT_TRUE(none) << none.error().message;
  EXPECT_THAT(none->values, ElementsAre(190.97, 190.98, 254.93, 256.89, 0, 0, 0, 0, 0));
}

TEST_F(Calibration, KalibrErrorsNameTheKeyAndTheRemedy) {
  const std::string first = std::string(kCamchain).substr(0, std::string(kCamchain).find("cam1:"));
  expect_error(replaced(first, "camera_model: pinhole", "camera_model: omni"),
               ":3: camera_model 'omni' is not read; calibrate with Kalibr's pinhole-radtan or pinhole-equi");
  expect_error(replaced(first, "equidistant", "unified"), ":5: distortion_model 'unified'");
  expect_error(replaced(first, "equidistant", "fov"), ":4: 4 distortion coefficients, not 1");
  expect_error(replaced(first, "0.0034, ", ""), ":4: 3 distortion coefficients, not 4");
  expect_error(replaced(first, "190.97, ", ""), ":6: intrinsics: 3 numbers, not 4");
  expect_error(replaced(first, "190.97", "wide"), ":6: intrinsics: not a number");
  expect_error(replaced(first, "[512, 513]", "[512, 0]"), ":7: resolution");
  expect_error(replaced(first, "  resolution: [512, 513]\n", ""), "no 'resolution'");
  expect_error(replaced(first, "[190.97, 190.98, 254.93, 256.89]", "190.97"), "intrinsics is not a list");
  expect_error("cam0: 3\n", ":1: cam0");
}

TEST_F(Calibration, EurocSensorYaml) {
  const auto read = read_calibration(write(R"(# Default camera sensor yaml file
sensor_type: camera
comment: VI-Sensor cam0 (MT9M034)
T_BS:
  cols: 4
  rows: 4
  data: [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975,
         0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768,
        -0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
)"));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->width, 752);
  EXPECT_EQ(read->model, CameraModel::kPinholeRadtan);
  EXPECT_THAT(read->values, ElementsAre(458.654, 457.296, 367.215, 248.375, -0.28340811, 0.07395907,
                                        0.00019359, 1.76187114e-05, 0));
}

TEST_F(Calibration, PtamCountsInImageSides) {
  for (const char* text : {"Camera.Parameters=[ 0.738 1.0112 0.4996 0.51 0.1794 ]\n",
                           "// GVars\nCamera.Parameters = [0.738 1.0112 0.4996 0.51 0.1794];\n",
                           "0.738 1.0112 0.4996 0.51 0.1794\n"}) {
    const auto read = read_calibration(write(text), ImageSize{640, 480});
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(read->model, CameraModel::kFov);
    EXPECT_EQ(read->width, 640);
    EXPECT_EQ(read->height, 480);
    EXPECT_THAT(read->values,
                ElementsAre(0.738 * 640, 1.0112 * 480, 0.4996 * 640 - 0.5, 0.51 * 480 - 0.5, 0.1794));
    expect_error(text, "count in image sizes, and the source does not tell its size");
  }
}

TEST_F(Calibration, KalibrYamlWrittenReadsBackEqual) {
  const std::vector<CameraParameters> cameras = {
      {CameraModel::kPinholeRadtan, 640, 480, {500.1, 501.0 / 3, 319.5, 1e-3, -0.1, 0.02, 1e-5, -1.0 / 7, 0}},
      {CameraModel::kKannalaBrandt, 512, 511, {190.1, 190.0 / 3, 254.9, 256, 0.003, 1.0 / 7, -2e-3, 2e-17}},
      {CameraModel::kFov, 1280, 1024, {457.3, 456, 640, 512, 0.93}}};
  for (const auto& parameters : cameras) {
    const auto path = directory_.path() / "cam.yaml";
    ASSERT_TRUE(write_calibration_kalibr(path, parameters, "made by a test\nof two lines"));
    const auto back = read_calibration(path);
    ASSERT_TRUE(back) << back.error().message;
    EXPECT_EQ(*back, parameters) << name_of(parameters.model);
  }
  auto with_k3 = cameras[0];
  with_k3.values[8] = 0.1;
  EXPECT_EQ(write_calibration_kalibr(directory_.path() / "k3.yaml", with_k3).error().code,
            ErrorCode::kConfiguration);
  EXPECT_FALSE(std::filesystem::exists(directory_.path() / "k3.yaml"));
  EXPECT_EQ(write_calibration_txt(directory_.path() / "kb4.txt", cameras[1]).error().code,
            ErrorCode::kConfiguration);
  EXPECT_EQ(write_calibration_kalibr("/nowhere/cam.yaml", cameras[1]).error().code, ErrorCode::kIo);
}

TEST_F(Calibration, YamlErrorsNameTheLine) {
  expect_error(replaced(kRosYaml, "plumb_bob", "thin_prism"), ":5: distortion_model 'thin_prism'");
  expect_error(replaced(replaced(kRosYaml, "plumb_bob", "equidistant"), "0, 0, 0, 0]", "0, 0, 0, 1]"),
               ":6: 5 distortion coefficients, not 4");
  expect_error(replaced(kRosYaml, "image_width: 640", "image_width: wide"), ":1: image_width");
  expect_error(replaced(kRosYaml, "image_height: 480\n", ""), "image_height");
  expect_error(replaced(kRosYaml, "[500, 0, 320", "[500, 3, 320"), ":4: camera_matrix");
  expect_error(replaced(kRosYaml, "0, 0, 1]", "0, 0]"), ":4: camera_matrix");
  expect_error(replaced(kRosYaml, "0.1, 0, 0, 0, 0", "0.1, 0, 0, 0, 0, 0, 2"), ":6: more than 5");
  expect_error(replaced(kRosYaml, "data: [0.1", "dota: [0.1"), ":6: distortion_coefficients");
  expect_error("%YAML:1.0\n---\na: [1, 2\nb: }", "not YAML");
  expect_error("camera: 1\n", "neither camera_matrix nor intrinsics");
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

TEST_F(Calibration, WhatNoCameraCanBeIsRefused) {
  expect_error("640 480 502,3 501,7 321,4 238,2\n", "decimal point");
  expect_error("640 480 502.3 70 320 240\n", "far from each other");
  expect_error("640 480 5 5 320 240\n", "focal lengths 5 and 5 px for an image of 640x480");
  expect_error("640 480 525 525 9999 240\n", "principal point 9999, 240 lies outside");
  expect_error("640 480 525 525 320 -1\n", "principal point");
  expect_error("640 480 500 500 320 240 -18 0 0 0\n", "folds the image over");
  for (const char* content : {"640 480 160 160 10 470 -0.3 0.05 0 0\n", "640 480 12000 3000 320 240\n",
                              "640, 480, 525.0, 525.5, 319.5, 239.5\n"}) {
    const auto odd = read_calibration(write(content));
    EXPECT_TRUE(odd) << odd.error().message;
  }
}

TEST_F(Calibration, MissingFileSaysWhatToDo) {
  const auto read = read_calibration(directory_.path() / "none.txt");
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(read.error().message, HasSubstr("--calibration"));
}

}  // namespace
}  // namespace cairn
