// SPDX-License-Identifier: Apache-2.0
#include "server/admin/scene_files.h"

#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "common/io/test_directory.h"

namespace cairn {
namespace {

std::string content_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// What cameras.txt says of a camera of fx 8, fy 9, cx 4, cy 3 and these further values.
std::string row_of(CameraModel model, const std::vector<double>& more) {
  const TestDirectory directory;
  std::vector<double> values{8, 9, 4, 3};
  values.insert(values.end(), more.begin(), more.end());
  ExportedScene scene;
  scene.cameras[1] = {model, 8, 6, values};
  EXPECT_TRUE(write_colmap_text(scene, directory.path()));
  const std::string text = content_of(directory.path() / "cameras.txt");
  return text.substr(text.find('\n') + 1);
}

/// COLMAP's number of the only camera's model in cameras.bin.
int32_t model_of(const std::vector<double>& values) {
  const TestDirectory directory;
  ExportedScene scene;
  scene.cameras[1] = {CameraModel::kPinholeRadtan, 8, 6, values};
  EXPECT_TRUE(write_colmap_binary(scene, directory.path()));
  int32_t model = 0;
  const std::string bytes = content_of(directory.path() / "cameras.bin");
  std::memcpy(&model, bytes.data() + sizeof(uint64_t) + sizeof(uint32_t), sizeof(model));
  return model;
}

TEST(SceneFiles, ACameraWithoutDistortionIsAPinhole) {
  for (const size_t zeros : {0, 4, 5}) {
    EXPECT_EQ(row_of(CameraModel::kPinholeRadtan, std::vector<double>(zeros)), "1 PINHOLE 8 6 8 9 4.5 3.5\n");
  }
  EXPECT_EQ(row_of(CameraModel::kPinholeRadtan, {0, 0, 0, 0.01}), "1 OPENCV 8 6 8 9 4.5 3.5 0 0 0 0.01\n");
  EXPECT_EQ(row_of(CameraModel::kKannalaBrandt, {0, 0, 0, 0}), "1 OPENCV_FISHEYE 8 6 8 9 4.5 3.5 0 0 0 0\n");
  EXPECT_EQ(model_of({8, 9, 4, 3, 0, 0, 0, 0}), 1);
  EXPECT_EQ(model_of({8, 9, 4, 3, 0.5, 0, 0, 0}), 4);
}

TEST(SceneFiles, ImagesAreGreyOrOnDemandOfThreeEqualChannels) {
  auto image = std::make_shared<GrayImage>(8, 6);
  for (int y = 0; y < 6; ++y) {
    for (int x = 0; x < 8; ++x) image->row(y)[x] = static_cast<uint8_t>(20 * y + x);
  }
  ExportedScene scene;
  scene.images.emplace_back().file = "keyframe-000001.png";
  scene.images.back().image = image;
  for (const bool rgb : {false, true}) {
    scene.rgb = rgb;
    const TestDirectory directory;
    ASSERT_TRUE(write_images(scene, directory.path()));
    const cv::Mat read =
        cv::imread((directory.path() / "keyframe-000001.png").string(), cv::IMREAD_UNCHANGED);
    ASSERT_EQ(read.size(), cv::Size(8, 6));
    ASSERT_EQ(read.channels(), rgb ? 3 : 1);
    for (int y = 0; y < 6; ++y) {
      for (int x = 0; x < 8 * read.channels(); ++x)
        ASSERT_EQ(read.ptr(y)[x], image->row(y)[x / read.channels()]);
    }
  }
}

}  // namespace
}  // namespace cairn
