// SPDX-License-Identifier: Apache-2.0
#include "common/io/image_file.h"

#include <gmock/gmock.h>

#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <random>
#include <string>

#include "common/io/image_header.h"
#include "common/io/test_directory.h"
#include "common/io/text.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;
using Bytes = std::vector<uint8_t>;

cv::Mat noise_image(int width, int height) {
  cv::Mat image(height, width, CV_8U);
  std::mt19937 random(5);
  for (auto it = image.begin<uint8_t>(); it != image.end<uint8_t>(); ++it)
    *it = static_cast<uint8_t>(random());
  return image;
}

Bytes encode(const std::string& extension, const cv::Mat& image, const std::vector<int>& parameters = {}) {
  Bytes bytes;
  EXPECT_TRUE(cv::imencode(extension, image, bytes, parameters));
  return bytes;
}

struct Codec {
  std::string name;
  std::string extension;
  std::vector<int> parameters;
};

class ImageFile : public ::testing::TestWithParam<Codec> {
 protected:
  [[nodiscard]] Bytes encoded(const cv::Mat& image) const {
    return encode(GetParam().extension, image, GetParam().parameters);
  }
};

TEST_P(ImageFile, DecodesWhatOpenCvWrote) {
  const cv::Mat image = noise_image(173, 91);
  const auto decoded = decode_gray_image(encoded(image));
  ASSERT_TRUE(decoded) << decoded.error().message;
  ASSERT_EQ(decoded->width(), 173);
  ASSERT_EQ(decoded->height(), 91);
  const cv::Mat expected = cv::imdecode(encoded(image), cv::IMREAD_GRAYSCALE);
  for (int y = 0; y < 91; ++y) {
    ASSERT_EQ(0, std::memcmp(decoded->row(y), expected.ptr(y), 173)) << "row " << y;
  }
}

TEST_P(ImageFile, EveryTruncationIsAnErrorAndNoneACrash) {
  const Bytes whole = encoded(noise_image(64, 48));
  for (size_t keep = 0; keep < whole.size(); keep += 1 + whole.size() / 150) {
    const auto decoded = decode_gray_image(std::span(whole).first(keep));
    ASSERT_FALSE(decoded) << keep << " of " << whole.size() << " bytes";
    ASSERT_EQ(decoded.error().code, ErrorCode::kDamaged);
  }
}

TEST_P(ImageFile, FlippedBitsNeverCrash) {
  const Bytes whole = encoded(noise_image(64, 48));
  std::mt19937 random(9);
  for (int trial = 0; trial < 300; ++trial) {
    Bytes bytes = whole;
    for (int i = 0; i < 3; ++i) bytes[random() % std::min<size_t>(bytes.size(), 700)] ^= 1U << (random() % 8);
    if (const auto decoded = decode_gray_image(bytes)) {
      EXPECT_LE(decoded->width(), kMaxImageSide);
      EXPECT_LE(decoded->height(), kMaxImageSide);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Formats, ImageFile,
                         ::testing::Values(Codec{"Png", ".png", {}}, Codec{"Jpeg", ".jpg", {}},
                                           Codec{
                                               "ProgressiveJpeg", ".jpg", {cv::IMWRITE_JPEG_PROGRESSIVE, 1}},
                                           Codec{"RestartJpeg", ".jpg", {cv::IMWRITE_JPEG_RST_INTERVAL, 2}},
                                           Codec{"Pgm", ".pgm", {}}),
                         [](const auto& info) { return info.param.name; });

TEST(ImageHeader, AJpegWhoseThumbnailIsWholeIsStillCut) {
  const Bytes thumbnail = encode(".jpg", noise_image(16, 16));
  const Bytes whole = encode(".jpg", noise_image(64, 48));
  Bytes bytes = {0xFF, 0xD8, 0xFF, 0xE1};
  const size_t length = thumbnail.size() + 2;
  bytes.push_back(static_cast<uint8_t>(length >> 8));
  bytes.push_back(static_cast<uint8_t>(length));
  bytes.insert(bytes.end(), thumbnail.begin(), thumbnail.end());
  bytes.insert(bytes.end(), whole.begin() + 2, whole.end());
  const auto header = read_image_header(bytes);
  ASSERT_TRUE(header);
  EXPECT_EQ(header->width, 64);
  EXPECT_TRUE(header->complete);
  bytes.resize(bytes.size() - 100);
  EXPECT_FALSE(read_image_header(bytes)->complete);
}

TEST(ImageHeader, AForgedSizeIsRefusedBeforeMemoryIsTaken) {
  Bytes png = encode(".png", noise_image(16, 16));
  png[16] = 0x7F;  // width 2^31 - ...
  const auto decoded = decode_gray_image(png);
  ASSERT_FALSE(decoded);
  EXPECT_THAT(decoded.error().message, HasSubstr(std::to_string(kMaxImageSide)));
  const std::string pgm = "P5\n# big\n" + std::to_string(kMaxImageSide + 1) + " 2\n255\n";
  EXPECT_THAT(decode_gray_image({reinterpret_cast<const uint8_t*>(pgm.data()), pgm.size()}).error().message,
              HasSubstr(std::to_string(kMaxImageSide + 1) + "x2"));
}

/// What the header says and what a decoder would make must be one: else a few bytes take the machine's
/// memory.
TEST(ImageHeader, AGigapixelDoesNotHideBehindASmallImage) {
  const auto words = [](const Bytes& bytes) {
    const auto decoded = decode_gray_image(bytes);
    return decoded ? "decoded" : decoded.error().message;
  };
  const Bytes jpeg = encode(".jpg", noise_image(64, 48));
  const Bytes small_frame = {0xFF, 0xC0, 0, 11, 8, 0, 16, 0, 16, 1, 1, 0x11, 0};
  Bytes second_frame = jpeg;
  second_frame.insert(second_frame.end() - 2, small_frame.begin(), small_frame.end());
  EXPECT_THAT(words(second_frame), HasSubstr("two frames"));

  const Bytes scan = {0xFF, 0xDA, 0, 8, 1, 1, 0, 0, 63, 0};
  Bytes many_scans = jpeg;
  for (int i = 0; i < 200; ++i) many_scans.insert(many_scans.end() - 2, scan.begin(), scan.end());
  EXPECT_THAT(words(many_scans), HasSubstr("more than 100 scans"));

  const Bytes unknown_chunk = {0, 0, 0, 8, 'a', 'a', 'A', 'a', 0, 0, 0, 16, 0, 0, 0, 16, 0x7B, 0x2F, 0x4E, 0};
  Bytes late_header = encode(".png", noise_image(64, 48));
  late_header.insert(late_header.begin() + 8, unknown_chunk.begin(), unknown_chunk.end());
  EXPECT_THAT(words(late_header), HasSubstr("does not begin with its header"));

  for (const std::string pgm : {"P5 #\r30000 30000 255\n16 16\n255\n.", "P5\n16#262144 255\n16\n255\n.",
                                "P5x16 16 255\n.", "P5\n16 -16 255\n."}) {
    const Bytes bytes(pgm.begin(), pgm.end());
    EXPECT_FALSE(decode_gray_image(bytes)) << pgm;
  }
}

/// A decoder takes memory for as many bytes as a chunk says it has.
TEST(ImageHeader, NoChunkIsLongerThanItsFile) {
  const Bytes whole = encode(".png", noise_image(64, 48));
  const Bytes claim = {0x26, 0, 0, 0, 'i', 'T', 'X', 't', 'a', 0, 0, 0, 0, 0, 0, 0};
  constexpr size_t kHeader = 8 + 25;
  constexpr size_t kEnd = 12;
  for (const size_t at : {kHeader, whole.size() - kEnd}) {
    Bytes forged = whole;
    forged.insert(forged.begin() + static_cast<ptrdiff_t>(at), claim.begin(), claim.end());
    const auto decoded = decode_gray_image(forged);
    ASSERT_FALSE(decoded);
    EXPECT_THAT(decoded.error().message, HasSubstr("64x48) is cut short"));
  }
}

TEST(ImageFileErrors, NameTheFileAndTheTrouble) {
  const TestDirectory directory;
  const auto path = directory.path() / "a.png";
  const auto expect = [&](ErrorCode code, const std::string& part) {
    const auto read = read_gray_image(path);
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().code, code) << read.error().message;
    EXPECT_THAT(read.error().message, HasSubstr(path.string()));
    EXPECT_THAT(read.error().message, HasSubstr(part));
  };
  expect(ErrorCode::kNotFound, "no such file");
  std::ofstream(path).close();
  expect(ErrorCode::kDamaged, "empty");
  std::ofstream(path) << "version https://git-lfs.github.com/spec/v1\n";
  expect(ErrorCode::kDamaged, "not an image");
  std::filesystem::remove(path);
  std::filesystem::create_directory(path);
  expect(ErrorCode::kIo, "not a regular file");
}

}  // namespace
}  // namespace cairn
