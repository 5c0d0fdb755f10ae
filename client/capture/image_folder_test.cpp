// SPDX-License-Identifier: Apache-2.0
#include "client/capture/image_folder.h"

#include <gmock/gmock.h>

#include "client/capture/source_files_fixture.h"

namespace cairn {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::vector<std::string> patterns_of(const std::vector<std::string>& names) {
  std::vector<std::string> patterns;
  for (const auto& kind : kinds_side_by_side({names.begin(), names.end()})) patterns.push_back(kind.pattern);
  return patterns;
}

TEST(ImageKinds, SideBySideAreToldApart) {
  EXPECT_THAT(patterns_of({"f-0.color.jpg", "f-0.depth.png", "f-1.color.jpg", "f-1.depth.png"}),
              ElementsAre("f-*.color.jpg", "f-*.depth.png"));
  EXPECT_THAT(patterns_of({"0001.png", "0001_mask.png", "0002.png", "0002_mask.png", "0003.png"}),
              ElementsAre("*.png", "*_mask.png"));
  EXPECT_THAT(patterns_of({"1.jpg", "1.png", "2.jpg", "2.png"}), ElementsAre("*.jpg", "*.png"));
  EXPECT_THAT(patterns_of({"left1.png", "left2.png", "right1.png", "right2.png"}),
              ElementsAre("left*.png", "right*.png"));
}

TEST(ImageKinds, OneRecordingIsOne) {
  EXPECT_TRUE(patterns_of({}).empty());
  EXPECT_TRUE(patterns_of({"0.png", "1.png", "10.png"}).empty());
  EXPECT_TRUE(patterns_of({"0-cover.jpg", "1.jpg", "2.jpg", "3.jpg"}).empty());
  EXPECT_TRUE(patterns_of({"IMG_1.jpg", "IMG_2.JPG", "img_3.jpg"}).empty());
  EXPECT_TRUE(patterns_of({"a.png", "b.png", "c.png", "d.png"}).empty());
  EXPECT_TRUE(patterns_of({"3fa2.png", "81bc.png", "9d0e.png", "f200.png", "a1b2.png"}).empty());
  EXPECT_TRUE(patterns_of({"day1_1.png", "day1_2.png", "night2_1.png", "night2_2.png"}).empty());
}

class ImageFolders : public FrameSourceFiles {
 protected:
  std::vector<int> numbers_in(const std::string& options) {
    const auto source = open_source(uri("images", options));
    EXPECT_TRUE(source) << source.error().message;
    std::vector<int> numbers;
    if (!source) return numbers;
    for (const auto& frame : take_all(**source).frames) numbers.push_back(number_of(frame));
    return numbers;
  }
};

TEST_F(ImageFolders, HiddenFilesAreNoFrames) {
  for (int i = 0; i < 3; ++i) {
    write_image("IMG_" + std::to_string(i) + ".jpg", i);
    write_text("._IMG_" + std::to_string(i) + ".jpg", "\1");
  }
  write_text(".DS_Store", "x");
  write_text("Thumbs.db", "x");
  const auto source = open_source(uri("images"));
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ((*source)->frame_count(), 3U);
  EXPECT_TRUE(take_all(**source).errors.empty());
  ASSERT_EQ((*source)->notes().size(), 1U);
  EXPECT_THAT((*source)->notes()[0].text, HasSubstr("3 hidden files"));

  write_text("rgb.txt", "0 ._IMG_0.jpg\n0 IMG_0.jpg\n0.1 ._IMG_1.jpg\n0.1 IMG_1.jpg\n");
  EXPECT_EQ((*open_source(uri("tum")))->frame_count(), 2U);
}

TEST_F(ImageFolders, SeveralKindsAreRefusedUntilOneIsChosen) {
  for (int i = 0; i < 3; ++i) {
    write_image("f-" + std::to_string(i) + ".color.jpg", i);
    write_image("f-" + std::to_string(i) + ".depth.png", i + 6);
  }
  const auto source = open_source(uri("images"));
  ASSERT_FALSE(source);
  EXPECT_EQ(source.error().code, ErrorCode::kConfiguration);
  EXPECT_THAT(source.error().message,
              AllOf(HasSubstr("3 like f-0.color.jpg (64x48, 8 bits), 3 like f-0.depth.png"),
                    HasSubstr("?match=f-*.color.jpg")));
  EXPECT_THAT(numbers_in("?match=f-*.color.jpg"), ElementsAre(0, 1, 2));
  EXPECT_THAT(numbers_in("?match=*.DEPTH.*&fps=5"), ElementsAre(6, 7, 8));
  EXPECT_THAT(numbers_in("?match=*"), ElementsAre(0, 6, 1, 7, 2, 8));
  expect_open_error(uri("images", "?match=*.tif"), ErrorCode::kNotFound, "matches '*.tif'");
}

TEST_F(ImageFolders, TheGlobThatIsProposedTakesOneKind) {
  for (int i = 1; i <= 2; ++i) {
    write_image("000" + std::to_string(i) + ".png", i);
    write_image("000" + std::to_string(i) + "_mask.png", i + 6);
  }
  const auto source = open_source(uri("images"));
  ASSERT_FALSE(source);
  const std::string& text = source.error().message;
  const size_t begin = text.find("?match=");
  ASSERT_NE(begin, std::string::npos) << text;
  EXPECT_THAT(numbers_in(text.substr(begin, text.find('"', begin) - begin)), ElementsAre(1, 2));
}

TEST_F(ImageFolders, TheCommonestSizeIsThatOfTheFrames) {
  ASSERT_TRUE(cv::imwrite((dir() / "0-cover.jpg").string(), cv::Mat(20, 30, CV_8U, cv::Scalar(99))));
  for (int i = 1; i < 5; ++i) write_image(std::to_string(i) + ".jpg", i);
  const auto source = open_source(uri("images"));
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ((*source)->image_size(), (ImageSize{kWidth, kHeight}));
  const auto taken = take_all(**source);
  EXPECT_THAT(taken.errors, ElementsAre(HasSubstr("0-cover.jpg: is 30x20, the others are 64x48")));
  ASSERT_EQ(taken.frames.size(), 4U);
  EXPECT_EQ(taken.frames[0].index, 1U);
}

}  // namespace
}  // namespace cairn
