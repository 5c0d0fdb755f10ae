// SPDX-License-Identifier: Apache-2.0
#include "common/io/orientation.h"

#include <gmock/gmock.h>

#include <cstring>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "common/io/image_file.h"
#include "common/io/image_header.h"
#include "common/io/test_directory.h"
#include "common/io/test_exif.h"

namespace cairn {
namespace {

using Bytes = std::vector<uint8_t>;

/// Every part of it is another grey.
cv::Mat slope() {
  cv::Mat image(48, 64, CV_8U);
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols; ++x) image.at<uint8_t>(y, x) = static_cast<uint8_t>(2 * x + y);
  return image;
}

GrayImage read(const Bytes& bytes) {
  const TestDirectory directory;
  const auto path = directory.path() / "image";
  std::ofstream(path, std::ios::binary).write(reinterpret_cast<const char*>(bytes.data()), std::ssize(bytes));
  auto image = read_gray_image(path);
  EXPECT_TRUE(image) << image.error().message;
  return image ? std::move(*image) : GrayImage(1, 1);
}

void expect_equal(const GrayImage& image, const cv::Mat& wanted) {
  ASSERT_EQ(image.width(), wanted.cols);
  ASSERT_EQ(image.height(), wanted.rows);
  for (int y = 0; y < wanted.rows; ++y)
    ASSERT_EQ(0, std::memcmp(image.row(y), wanted.ptr(y), static_cast<size_t>(wanted.cols))) << y;
}

Bytes png_held(const cv::Mat& pixels, int orientation) {
  Bytes png;
  cv::imencode(".png", pixels, png);
  const auto exif = exif_of(orientation);
  Bytes chunk = {'e', 'X', 'I', 'f'};
  chunk.insert(chunk.end(), exif.begin(), exif.end());
  uint32_t crc = 0xFFFFFFFF;  // PNG specification, annex D
  for (const uint8_t byte : chunk) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1) != 0 ? 0xEDB88320U : 0U);
  }
  crc = ~crc;
  for (int shift = 24; shift >= 0; shift -= 8) chunk.push_back(static_cast<uint8_t>(crc >> shift));
  chunk.insert(chunk.begin(), {0, 0, 0, static_cast<uint8_t>(exif.size())});
  png.insert(png.begin() + 33, chunk.begin(), chunk.end());  // behind IHDR
  return png;
}

TEST(Orientation, StillsAreShownAsViewersDo) {
  for (int orientation = 1; orientation <= 8; ++orientation) {
    for (const bool is_little_endian : {false, true}) {
      SCOPED_TRACE(orientation);
      const auto jpeg = jpeg_held(slope(), orientation, is_little_endian);
      EXPECT_EQ(read_image_header(jpeg)->orientation, orientation);
      expect_equal(read(jpeg), cv::imdecode(jpeg, cv::IMREAD_GRAYSCALE));
    }
  }
}

TEST(Orientation, ChunksOfPngToo) {
  const auto png = png_held(slope(), 6);
  EXPECT_EQ(read_image_header(png)->orientation, 6);
  cv::Mat turned;
  cv::rotate(slope(), turned, cv::ROTATE_90_CLOCKWISE);
  expect_equal(read(png), turned);
}

TEST(Orientation, IsOfFilesOnlyNotOfImagesFromPeers) {
  const auto image = decode_gray_image(jpeg_held(slope(), 6));
  ASSERT_TRUE(image);
  EXPECT_EQ(image->width(), slope().cols);
}

TEST(Orientation, WhatMakesNoSenseIsUprightAndNoCrash) {
  for (const int orientation : {0, 9, 65535}) EXPECT_EQ(exif_orientation(exif_of(orientation)), kUpright);
  const auto whole = exif_of(6);
  for (size_t size = 0; size < whole.size(); ++size) {
    const int found = exif_orientation(std::span(whole).first(size));
    EXPECT_TRUE(found == kUpright || found == 6) << size;
  }
  for (size_t at = 0; at < whole.size(); ++at) {
    Bytes broken = whole;
    broken[at] = 0xFF;
    const int found = exif_orientation(broken);
    EXPECT_TRUE(found == kUpright || found == 6) << at;
  }
}

TEST(Orientation, IsSaid) {
  EXPECT_EQ(orientation_words(1), "");
  EXPECT_EQ(orientation_words(2), "mirrored");
  EXPECT_EQ(orientation_words(6), "turned by 90 degrees clockwise");
  EXPECT_EQ(orientation_words(7), "mirrored and turned by 90 degrees clockwise");
  EXPECT_EQ(orientation_words(8), "turned by 270 degrees clockwise");
}

}  // namespace
}  // namespace cairn
