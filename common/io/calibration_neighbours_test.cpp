// SPDX-License-Identifier: Apache-2.0
// Calibrations in the files of other programs.
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

#include "common/io/calibration_fixture.h"

namespace cairn {
namespace {

using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pointwise;

constexpr double kFine = 1e-9;

class NeighboursCalibration : public Calibration {
 protected:
  void expect(const std::string& content, CameraModel model, ImageSize size,
              const std::vector<double>& values, std::optional<ImageSize> source = {},
              const std::string& camera = "") {
    SCOPED_TRACE(content.substr(0, 300));
    const auto read = read_calibration(write(content).string() + camera, source);
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(read->model, model);
    EXPECT_EQ(read->width, size.width);
    EXPECT_EQ(read->height, size.height);
    EXPECT_THAT(read->values, Pointwise(DoubleNear(kFine), values));
  }
};

/// As OpenCV's calibration program writes it: the same keys for both lenses, and `fisheye_model` tells.
std::string opencv_file(const std::filesystem::path& path, bool fisheye) {
  cv::FileStorage file(path.string(), cv::FileStorage::WRITE | cv::FileStorage::MEMORY);
  file << "calibration_time"
       << "Tue Nov 25 2025"
       << "image_width" << 640 << "image_height" << 480;
  file << "flags" << 0 << "fisheye_model" << (fisheye ? 1 : 0);
  file << "camera_matrix" << (cv::Mat)(cv::Mat_<double>(3, 3) << 320, 0, 319.5, 0, 321, 239.5, 0, 0, 1);
  file << "distortion_coefficients" << (cv::Mat)(cv::Mat_<double>(4, 1) << -0.0093, 0.0462, -0.0434, 0.008);
  return file.releaseAndGetString();
}

TEST_F(NeighboursCalibration, OpenCvsFisheyeIsKannalaBrandtInYamlAndXml) {
  for (const char* name : {"a.yml", "a.xml"}) {
    expect(opencv_file(name, true), CameraModel::kKannalaBrandt, {640, 480},
           {320, 321, 319.5, 239.5, -0.0093, 0.0462, -0.0434, 0.008});
    expect(opencv_file(name, false), CameraModel::kPinholeRadtan, {640, 480},
           {320, 321, 319.5, 239.5, -0.0093, 0.0462, -0.0434, 0.008, 0});
  }
}

TEST_F(NeighboursCalibration, OpenCvsFisheyeProjectsAsOpenCvDoes) {
  const auto read = read_calibration(write(opencv_file("a.yml", true)));
  ASSERT_TRUE(read) << read.error().message;
  const auto camera = make_camera(*read);
  ASSERT_TRUE(camera);
  const cv::Matx33d matrix(320, 0, 319.5, 0, 321, 239.5, 0, 0, 1);
  const std::vector<double> coefficients = {-0.0093, 0.0462, -0.0434, 0.008};
  std::vector<cv::Point2d> pixels;
  const std::vector<cv::Point3d> points = {{0.3, -0.2, 1}, {-1.2, 0.7, 1}, {0, 0, 1}};
  cv::fisheye::projectPoints(points, pixels, cv::Vec3d(0, 0, 0), cv::Vec3d(0, 0, 0), matrix, coefficients);
  for (size_t i = 0; i < points.size(); ++i) {
    const auto pixel = (*camera)->project({points[i].x, points[i].y, points[i].z});
    ASSERT_TRUE(pixel);
    EXPECT_NEAR(pixel->x(), pixels[i].x, 1e-6);
    EXPECT_NEAR(pixel->y(), pixels[i].y, 1e-6);
  }
}

TEST_F(NeighboursCalibration, OpenCvsOlderNamesAreRead) {
  const std::string content = R"(%YAML:1.0
image_Width: 640
image_Height: 480
Camera_Matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 500., 0., 320., 0., 501., 240., 0., 0., 1. ]
Distortion_Coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 0.1, 0., 0., 0., 0.2 ]
)";
  expect(content, CameraModel::kPinholeRadtan, {640, 480}, {500, 501, 320, 240, 0.1, 0, 0, 0, 0.2});
}

TEST_F(NeighboursCalibration, XmlWithoutACalibrationIsNamed) {
  expect_error("<?xml version=\"1.0\"?>\n<calibration><width>640</width></calibration>\n", "XML without");
  expect_error("<?xml version=\"1.0\"?>\n<opencv_storage><camera_matrix><data>1 2", "XML without");
  expect_error(replaced(opencv_file("a.xml", true), "<image_width>640", "<image_width>wide"),
               "image_width is not a number");
}

constexpr const char* kEcho = R"(header:
  stamp:
    sec: 1700000000
    nanosec: 5
  frame_id: camera
height: 480
width: 640
distortion_model: plumb_bob
d:
- 0.1
- -0.2
- 0.001
- 0.002
- 0.0
k:
- 500.0
- 0.0
- 320.0
- 0.0
- 501.0
- 240.0
- 0.0
- 0.0
- 1.0
r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
p: [400.0, 0.0, 310.0, 0.0, 0.0, 400.0, 230.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 0
roi:
  x_offset: 0
  y_offset: 0
  height: 0
  width: 0
  do_rectify: false
---
)";

TEST_F(NeighboursCalibration, CameraInfoIsReadAsItIsEchoed) {
  const std::vector<double> values = {500, 501, 320, 240, 0.1, -0.2, 0.001, 0.002, 0};
  expect(kEcho, CameraModel::kPinholeRadtan, {640, 480}, values);
  expect(std::string(kEcho) + kEcho + "header:\n  sta", CameraModel::kPinholeRadtan, {640, 480}, values);
  const auto ros1 = replaced(replaced(kEcho, "\nd:", "\nD:"), "\nk:", "\nK:");
  expect(ros1, CameraModel::kPinholeRadtan, {640, 480}, values);
  expect(replaced(kEcho, "plumb_bob", "equidistant"), CameraModel::kKannalaBrandt, {640, 480},
         {500, 501, 320, 240, 0.1, -0.2, 0.001, 0.002});
}

TEST_F(NeighboursCalibration, CameraInfoOfOtherImagesIsRefused) {
  expect_error(replaced(kEcho, "binning_x: 0", "binning_x: 2"), ":27: the calibration is that of the whole");
  expect_error(replaced(kEcho, "x_offset: 0", "x_offset: 8"), "binned or cut out");
  expect_error(replaced(kEcho, "- 500.0", "- 0.0"), "a camera that nobody has calibrated");
}

constexpr const char* kOrbSlam3 = R"(%YAML:1.0

#------------------------------
# Camera Parameters. Adjust them!
File.version: "1.0"
Camera.type: "KannalaBrandt8"
Camera1.fx: 190.97
Camera1.fy: 190.98
Camera1.cx: 254.93
Camera1.cy: 256.89
Camera1.k1: 0.0034  # by Kalibr
Camera1.k2: 0.0007
Camera1.k3: -0.002
Camera1.k4: 0.0002
Camera.width: 512
Camera.height: 512
Camera.newWidth: 256
Camera.fps: 20
Viewer.PointSize:2
Tlr: !!opencv-matrix
  rows: 3
  data: [ 1.0,
            -0.0008]
)";

TEST_F(NeighboursCalibration, OrbSlam3) {
  expect(kOrbSlam3, CameraModel::kKannalaBrandt, {512, 512},
         {190.97, 190.98, 254.93, 256.89, 0.0034, 0.0007, -0.002, 0.0002});
  const std::string second =
      "Camera2.fx: 180\nCamera2.fy: 180\nCamera2.cx: 250\nCamera2.cy: 250\nCamera2.k1: 0\n"
      "Camera2.k2: 0\nCamera2.k3: 0\nCamera2.k4: 0\n";
  expect(kOrbSlam3 + second, CameraModel::kKannalaBrandt, {512, 512}, {180, 180, 250, 250, 0, 0, 0, 0}, {},
         "#Camera2");
  expect_error(kOrbSlam3 + second, "Camera1, Camera2; say which");
  expect_error(replaced(kOrbSlam3, "Camera1.k4: 0.0002\n", ""),
               "no 'Camera1.k4' in these settings of ORB-SLAM");
  expect_error(replaced(kOrbSlam3, "190.98", "wide"), ":8: Camera1.fy is not a number");
  expect_error(replaced(kOrbSlam3, "KannalaBrandt8", "Omni"), ":6: Camera.type 'Omni'");
  expect_error(replaced(kOrbSlam3, "height: 512", "height: 0"), "positive whole numbers");
}

constexpr const char* kOrbSlam2 = R"(%YAML:1.0

# Camera calibration and distortion parameters (OpenCV)
Camera.fx: 517.306408
Camera.fy: 516.469215
Camera.cx: 318.643040
Camera.cy: 255.313989

Camera.k1: 0.262383
Camera.k2: -0.953104
Camera.p1: -0.005358
Camera.p2: 0.002628
Camera.k3: 1.163314

Camera.bf: 40.0
Map.mapfile: map.bin
)";

TEST_F(NeighboursCalibration, OrbSlam2TakesTheSourcesSize) {
  expect(kOrbSlam2, CameraModel::kPinholeRadtan, {640, 480},
         {517.306408, 516.469215, 318.64304, 255.313989, 0.262383, -0.953104, -0.005358, 0.002628, 1.163314},
         ImageSize{640, 480});
  expect(replaced(kOrbSlam2, "Camera.k3: 1.163314\n", "Camera.type: \"Rectified\"\n"),
         CameraModel::kPinholeRadtan, {640, 480},
         {517.306408, 516.469215, 318.64304, 255.313989, 0, 0, 0, 0, 0}, ImageSize{640, 480});
  expect_error(kOrbSlam2, "without Camera.width and Camera.height");
}

constexpr const char* kVins = R"(%YAML:1.0
---
model_type: PINHOLE
camera_name: camera
image_width: 752
image_height: 480
distortion_parameters:
   k1: -2.9e-01
   k2: 8.0e-02
   p1: 1.0e-04
   p2: 2.0e-05
projection_parameters:
   fx: 461.6
   fy: 460.3
   cx: 363.0
   cy: 248.1
)";

TEST_F(NeighboursCalibration, Vins) {
  expect(kVins, CameraModel::kPinholeRadtan, {752, 480},
         {461.6, 460.3, 363, 248.1, -0.29, 0.08, 1e-4, 2e-5, 0});
  expect(R"(%YAML:1.0
---
model_type: KANNALA_BRANDT
camera_name: camera
image_width: 848
image_height: 800
projection_parameters:
   k2: -0.007
   k3: 0.042
   k4: -0.039
   k5: 0.006
   mu: 286.2
   mv: 286.4
   u0: 421.4
   v0: 400.7
)",
         CameraModel::kKannalaBrandt, {848, 800}, {286.2, 286.4, 421.4, 400.7, -0.007, 0.042, -0.039, 0.006});
  expect_error(replaced(kVins, "PINHOLE", "MEI"), ":3: model_type 'MEI' of VINS is not read; calibrate with");
  expect_error(replaced(kVins, "   cy: 248.1\n", ""), "no 'cy'");
  expect_error("%YAML:1.0\n---\nimu: 1\ncam0_calib: \"cam0_pinhole.yaml\"\nimage_width: 752\n",
               ":4: the settings of VINS-Fusion; pass the file of its camera: 'cam0_pinhole.yaml'");
}

TEST_F(NeighboursCalibration, ColmapCountsFromTheCornerOfThePixel) {
  const std::string head =
      "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT\n";
  struct Case {
    const char* row;
    CameraModel model;
    std::vector<double> values;
  };
  const Case cases[] = {
      {"SIMPLE_PINHOLE 640 480 500 320 240",
       CameraModel::kPinholeRadtan,
       {500, 500, 319.5, 239.5, 0, 0, 0, 0, 0}},
      {"PINHOLE 640 480 500 501 320 240",
       CameraModel::kPinholeRadtan,
       {500, 501, 319.5, 239.5, 0, 0, 0, 0, 0}},
      {"SIMPLE_RADIAL 640 480 500 320 240 -0.1",
       CameraModel::kPinholeRadtan,
       {500, 500, 319.5, 239.5, -0.1, 0, 0, 0, 0}},
      {"RADIAL 640 480 500 320 240 -0.1 0.02",
       CameraModel::kPinholeRadtan,
       {500, 500, 319.5, 239.5, -0.1, 0.02, 0, 0, 0}},
      {"OPENCV 640 480 500 501 320 240 -0.1 0.02 1e-3 2e-3",
       CameraModel::kPinholeRadtan,
       {500, 501, 319.5, 239.5, -0.1, 0.02, 1e-3, 2e-3, 0}},
      {"FULL_OPENCV 640 480 500 501 320 240 -0.1 0.02 1e-3 2e-3 0.03 0 0 0",
       CameraModel::kPinholeRadtan,
       {500, 501, 319.5, 239.5, -0.1, 0.02, 1e-3, 2e-3, 0.03}},
      {"OPENCV_FISHEYE 640 480 300 301 320 240 -0.1 0.02 0.003 4e-4",
       CameraModel::kKannalaBrandt,
       {300, 301, 319.5, 239.5, -0.1, 0.02, 0.003, 4e-4}},
      {"RADIAL_FISHEYE 640 480 300 320 240 -0.1 0.02",
       CameraModel::kKannalaBrandt,
       {300, 300, 319.5, 239.5, -0.1, 0.02, 0, 0}},
      {"FOV 640 480 300 301 320 240 0.9", CameraModel::kFov, {300, 301, 319.5, 239.5, 0.9}}};
  for (const Case& c : cases) expect(head + "1 " + c.row + "\n", c.model, {640, 480}, c.values);
  const std::string two = head + "1 PINHOLE 640 480 500 501 320 240\n7 PINHOLE 320 240 250 251 160 120\n";
  expect(two, CameraModel::kPinholeRadtan, {320, 240}, {250, 251, 159.5, 119.5, 0, 0, 0, 0, 0}, {}, "#7");
  expect_error(two, "cameras in it: 1, 7; say which");
  expect_error("1 THIN_PRISM_FISHEYE 640 480 5 5 3 2 0 0 0 0 0 0 0 0\n",
               ":1: COLMAP's model 'THIN_PRISM_FISHEYE'");
  expect_error("1 OPENCV 640 480 500 501 320 240 -0.1\n", ":1: expected width, height and 8 numbers");
  expect_error("1 FULL_OPENCV 640 480 500 501 320 240 0 0 0 0 0 1 0 0\n", ":1: more than 5");
  expect_error("1 PINHOLE 640.5 480 500 501 320 240\n", "whole numbers");
}

TEST_F(NeighboursCalibration, LsdSlamAndDso) {
  const std::vector<double> fov = {0.527334 * 752, 0.827306 * 480, 0.473568 * 752 - 0.5, 0.499436 * 480 - 0.5,
                                   0.928161};
  expect("0.527334 0.827306 0.473568 0.499436 0.928161\n752 480\ncrop\n640 480\n", CameraModel::kFov,
         {752, 480}, fov);
  expect("FOV 0.527334 0.827306 0.473568 0.499436 0.928161\n752 480\nfull\n640 480\n", CameraModel::kFov,
         {752, 480}, fov);
  auto straight = fov;
  straight.resize(4);
  straight.resize(9, 0.0);
  expect("0.527334 0.827306 0.473568 0.499436 0\n752 480\nnone\n752 480\n", CameraModel::kPinholeRadtan,
         {752, 480}, straight);
  expect("500 500 350 240 -0.1 0 0 0\n752 480\ncrop\n640 480\n", CameraModel::kPinholeRadtan, {752, 480},
         {500, 500, 350, 240, -0.1, 0, 0, 0, 0});
  expect("RadTan 500 500 350 240 -0.1 0 0 0\n752 480\ncrop\n640 480\n", CameraModel::kPinholeRadtan,
         {752, 480}, {500, 500, 350, 240, -0.1, 0, 0, 0, 0});
  for (const std::string word : {"EquiDistant", "KannalaBrandt"}) {
    expect(word + " 0.349 0.465 0.499 0.499 0.031 0.01 -0.003 0\n640 480\nfull\n640 480\n",
           CameraModel::kKannalaBrandt, {640, 480},
           {0.349 * 640, 0.465 * 480, 0.499 * 640 - 0.5, 0.499 * 480 - 0.5, 0.031, 0.01, -0.003, 0});
  }
  expect_error("RadTan 500 500 350 240 wide 0 0 0\n752 480\n", ":1: expected numbers");
  expect_error("500 500 350 240 0 0 0 0\n752 480.5\n", ":2: expected width and height");
}

TEST_F(NeighboursCalibration, KittiOdometry) {
  const std::string p0 = "7.188560e+02 0 6.071928e+02 0 0 7.188560e+02 1.852157e+02 0 0 0 1 0\n";
  const std::string calib =
      "P0: " + p0 + "P1: " + replaced(p0, "02 0 0", "02 -386.1 0") +
      "Tr: 4.27e-04 -9.99e-01 -8.08e-03 -1.19e-02 -7.2e-03 8.08e-03 -9.99e-01 -5.4e-02 9.99e-01 "
      "4.8e-04 -7.2e-03 -2.9e-01\n";
  const ImageSize size{1241, 376};
  const std::vector<double> values = {718.856, 718.856, 607.1928, 185.2157, 0, 0, 0, 0, 0};
  expect(calib, CameraModel::kPinholeRadtan, size, values, size);
  expect("P0: " + p0, CameraModel::kPinholeRadtan, size, values, size);
  expect_error(calib, "KITTI's calibration has no image size");
  const std::string other = calib + "P2: " + replaced(p0, "6.07", "5.07");
  EXPECT_THAT(read_calibration(write(other), size).error().message, HasSubstr("P0, P1, P2; say which"));
  expect(other, CameraModel::kPinholeRadtan, size, {718.856, 718.856, 507.1928, 185.2157, 0, 0, 0, 0, 0},
         size, "#P2");
}

TEST_F(NeighboursCalibration, KittiRawIsChosenByTheImagesSize) {
  const std::string raw = R"(calib_time: 09-Jan-2012 13:57:47
corner_dist: 9.950000e-02
S_00: 1.392000e+03 5.120000e+02
K_00: 984.2439 0 690 0 980.8141 233.1966 0 0 1
D_00: -0.37 0.2 0.001 0.002 -0.07
S_rect_00: 1.242000e+03 3.750000e+02
P_rect_00: 721.5377 0 609.5593 0 0 721.5377 172.854 0 0 0 1 0
)";
  expect(raw, CameraModel::kPinholeRadtan, {1242, 375},
         {721.5377, 721.5377, 609.5593, 172.854, 0, 0, 0, 0, 0}, ImageSize{1242, 375});
  expect(raw, CameraModel::kPinholeRadtan, {1392, 512},
         {984.2439, 980.8141, 690, 233.1966, -0.37, 0.2, 0.001, 0.002, -0.07}, ImageSize{1392, 512});
  expect(raw, CameraModel::kPinholeRadtan, {1392, 512},
         {984.2439, 980.8141, 690, 233.1966, -0.37, 0.2, 0.001, 0.002, -0.07}, {}, "#K_00");
  expect_error(raw, "K_00, P_rect_00; say which");
  EXPECT_THAT(read_calibration(write(raw), ImageSize{640, 480}).error().message,
              HasSubstr("KITTI's calibration of images of another size"));
}

TEST_F(NeighboursCalibration, WhatIsNotReadIsNamed) {
  expect_error("%YAML:1.0\n---\nM1: !!opencv-matrix\n   rows: 3\n   data: [1]\n",
               ":3: OpenCV's stereo calibration");
  expect_error("cameras:\n - {distortion_type: equidistant}\n", "OKVIS or SVO");
  expect_error("{\"value0\": {\"intrinsics\": []}}\n", "Basalt");
  expect_error(std::string("PK\3\4\0\0", 6), "is not text");
}

TEST_F(NeighboursCalibration, ByteOrderMarksAndForeignLineEndsAreNoMatter) {
  const std::string mark = "\xef\xbb\xbf";
  for (std::string text : {std::string(kVins), std::string(kOrbSlam3), opencv_file("a.xml", true),
                           std::string("# c\n1 PINHOLE 640 480 500 501 320 240\n"),
                           std::string("width height fx fy cx cy\n640 480 500 500 320 240\n")}) {
    const auto plain = read_calibration(write(text));
    ASSERT_TRUE(plain) << plain.error().message;
    const auto marked = read_calibration(write(mark + text));
    ASSERT_TRUE(marked) << marked.error().message;
    EXPECT_EQ(*marked, *plain);
    std::replace(text.begin(), text.end(), '\n', '\r');
    const auto returns = read_calibration(write(text));
    ASSERT_TRUE(returns) << returns.error().message;
    EXPECT_EQ(*returns, *plain);
  }
  expect_error(std::string("\xff\xfe\x36\0", 4), "is UTF-16 text");
}

TEST(DescribeCamera, NamesTheLensInWords) {
  EXPECT_EQ(
      describe_camera({CameraModel::kKannalaBrandt, 640, 480, {320.12, 320.27, 320, 240, 0.1, 0, 0, 0}}),
      "Kannala-Brandt fisheye, 640x480, f 320.1 320.3");
  EXPECT_EQ(describe_camera({CameraModel::kPinholeRadtan, 752, 480, {458, 457, 367, 248, -0.28, 0, 0, 0, 0}}),
            "pinhole with radial-tangential distortion, 752x480, f 458.0 457.0");
  EXPECT_EQ(describe_camera({CameraModel::kPinholeRadtan, 640, 480, {525, 525, 320, 240, 0, 0, 0, 0, 0}}),
            "pinhole without distortion, 640x480, f 525.0 525.0");
  EXPECT_EQ(describe_camera({CameraModel::kFov, 640, 480, {300, 300, 320, 240, 0.9}}),
            "FOV lens (PTAM's), 640x480, f 300.0 300.0");
}

}  // namespace
}  // namespace cairn
