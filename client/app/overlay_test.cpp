// SPDX-License-Identifier: Apache-2.0
#include "client/app/overlay.h"

#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <sys/resource.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <random>
#include <sstream>

#include "client/app/test_doubles.h"
#include "client/app/video_writer.h"
#include "common/io/test_directory.h"

namespace cairn {
namespace {

using testing::at_ms;

CameraPtr test_camera(int width = 640, int height = 480) {
  auto camera = make_camera({CameraModel::kPinholeRadtan,
                             width,
                             height,
                             {0.8 * width, 0.8 * width, 0.5 * width, 0.5 * height, -0.25, 0.08, 0, 0, 0}});
  EXPECT_TRUE(camera) << camera.error().message;
  return *camera;
}

OverlayFrame plain_frame(const Camera& camera, int64_t ms = 0) {
  OverlayFrame frame;
  frame.image = std::make_shared<const GrayImage>(camera.width(), camera.height());
  frame.time = at_ms(ms);
  return frame;
}

/// An image that no codec makes small.
OverlayFrame noise_frame(const Camera& camera, int64_t ms) {
  std::mt19937 random(static_cast<unsigned>(ms));
  auto image = std::make_shared<GrayImage>(camera.width(), camera.height());
  for (int y = 0; y < image->height(); ++y)
    std::generate_n(image->row(y), image->width(), [&] { return static_cast<uint8_t>(random()); });
  auto frame = plain_frame(camera, ms);
  frame.image = std::move(image);
  return frame;
}

/// A camera one unit above Z = 0, looking at it from the side.
SE3 looking_down() {
  return {Eigen::Quaterniond(Eigen::AngleAxisd(2.4, Eigen::Vector3d::UnitX())), {0, 0, 1.2}};
}

/// Pixels with colour in them: the camera's image is grey.
int colored_pixels(const cv::Mat& image, const cv::Rect& area) {
  cv::Mat channels[3];
  cv::split(image(area), channels);
  return cv::countNonZero(channels[0] != channels[2]);
}

class OverlayTest : public ::testing::Test {
 protected:
  [[nodiscard]] cv::Rect image_area() const { return {0, 0, camera_->width(), camera_->height()}; }

  CameraPtr camera_ = test_camera();
  Overlay overlay_{camera_};
};

TEST_F(OverlayTest, WithoutPoseTheImageStaysGreyAndTheStatusIsWritten) {
  const auto& image = overlay_.draw(plain_frame(*camera_));
  EXPECT_EQ(image.size(), overlay_.size());
  EXPECT_EQ(colored_pixels(image, image_area()), 0);
  EXPECT_GT(colored_pixels(image, {0, camera_->height(), camera_->width(), 40}), 50);
}

TEST_F(OverlayTest, ALongStatusIsMadeToFit) {
  auto frame = plain_frame(*camera_);
  frame.note = "looking from where it was before; nobody answers, more cannot be done here";
  const auto& image = overlay_.draw(frame);
  EXPECT_GT(colored_pixels(image, {camera_->width() / 2, camera_->height(), camera_->width() / 2, 20}), 50);
  EXPECT_EQ(colored_pixels(image, {camera_->width() - 3, camera_->height(), 3, 20}), 0) << "nothing is cut";
}

TEST_F(OverlayTest, TheGridLiesWhereTheCameraProjectsIt) {
  auto frame = plain_frame(*camera_);
  frame.state = FrameState::kTracking;
  frame.camera_from_map = looking_down();
  frame.map = MapId{{1}};
  frame.mean_depth = 1.2;
  const cv::Mat image = overlay_.draw(frame).clone();
  EXPECT_GT(colored_pixels(image, image_area()), 1000);
  // Crossings of grid lines (a step of 0.1 for this depth) are coloured, places between them are not.
  int checked = 0;
  for (int i = -3; i <= 3; ++i) {
    const auto crossing = camera_->project(*frame.camera_from_map * Eigen::Vector3d(0.1 * i, -0.3, 0));
    const auto between = camera_->project(*frame.camera_from_map * Eigen::Vector3d(0.1 * i + 0.05, -0.35, 0));
    ASSERT_TRUE(crossing && between);
    if (!camera_->in_image(*crossing, 8) || !camera_->in_image(*between, 8)) continue;
    const auto around = [](const Eigen::Vector2d& p) {
      return cv::Rect(int(p.x()) - 1, int(p.y()) - 1, 3, 3);
    };
    EXPECT_GT(colored_pixels(image, around(*crossing)), 0) << i;
    EXPECT_EQ(colored_pixels(image, around(*between)), 0) << i;
    ++checked;
  }
  EXPECT_GE(checked, 4);
}

TEST_F(OverlayTest, AGridThatPassesBehindTheCameraIsCutAndNotMirrored) {
  auto frame = plain_frame(*camera_);
  frame.state = FrameState::kTracking;
  frame.map = MapId{{1}};
  frame.mean_depth = 1.0;
  // Level with the plane's horizon, 5 cm above it, in its middle: half of the grid is behind.
  frame.camera_from_map =
      SE3(Eigen::Quaterniond(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitX())), {0, 0.05, 0});
  const auto& image = overlay_.draw(frame);
  EXPECT_GT(colored_pixels(image, {0, camera_->height() / 2 + 10, camera_->width(), 200}), 500);
  // Above the horizon there is only the upright map axis.
  const int middle = camera_->width() / 2;
  EXPECT_EQ(colored_pixels(image, {0, 0, middle - 20, camera_->height() / 2 - 10}), 0);
  EXPECT_EQ(colored_pixels(image, {middle + 20, 0, middle - 20, camera_->height() / 2 - 10}), 0);
}

TEST_F(OverlayTest, PointsAreColouredByLevelAndMissedOnesAreFaint) {
  auto frame = plain_frame(*camera_);
  for (int level = 0; level < 4; ++level) {
    const auto x = static_cast<float>(100 + 100 * level);
    frame.points.push_back({PointId{1}, static_cast<uint8_t>(level), true, {x, 100}});
    frame.points.push_back({PointId{2}, static_cast<uint8_t>(level), false, {x, 200}});
  }
  const auto& image = overlay_.draw(frame);
  for (int level = 0; level < 4; ++level) {
    const int x = 100 + 100 * level;
    EXPECT_GT(colored_pixels(image, {x - 8, 92, 16, 16}), 3) << level;
    EXPECT_EQ(colored_pixels(image, {x - 8, 192, 16, 16}), 0) << level;
    EXPECT_GT(image.at<cv::Vec3b>(200, x)[0], 50) << level;
  }
}

TEST_F(OverlayTest, LabelsStandAtTheirPlaceAndOnlyWhereThereIsAPose) {
  auto frame = plain_frame(*camera_);
  frame.state = FrameState::kTracking;
  frame.map = MapId{{1}};
  frame.snapshot = std::make_shared<const MapSnapshot>();
  frame.camera_from_map = looking_down();
  Label label;
  label.id = {1};
  label.text = "vice";
  const Eigen::Vector2d pixel(400, 300);
  label.map_from_label =
      SE3(Eigen::Quaterniond::Identity(), looking_down().inverse() * (2 * camera_->unproject(pixel)));
  frame.labels = std::make_shared<const std::vector<Label>>(std::vector{label});
  const cv::Rect place(396, 296, 9, 9);
  EXPECT_GT(colored_pixels(overlay_.draw(frame), place), 20);
  frame.camera_from_map.reset();
  EXPECT_EQ(colored_pixels(overlay_.draw(frame), image_area()), 0);
}

TEST_F(OverlayTest, PointsCanBeLeftOut) {
  auto frame = plain_frame(*camera_);
  frame.points = {{PointId{1}, 0, true, {100, 100}}};
  EXPECT_GT(colored_pixels(overlay_.draw(frame), image_area()), 0);
  OverlayStyle style;
  style.points = false;
  EXPECT_EQ(colored_pixels(overlay_.draw(frame, style), image_area()), 0);
}

TEST_F(OverlayTest, NoNumbersOfTheTrackerMakeItFail) {
  auto frame = plain_frame(*camera_);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  frame.state = FrameState::kTracking;
  frame.map_name = "caf\xc3\xa9\n";
  frame.map = MapId{{2}};
  frame.camera_from_map = SE3(Eigen::Quaterniond::Identity(), {0, 0, 1e9});
  for (const double depth : {0.0, -1.0, std::numeric_limits<double>::infinity(), 1e-12, 1e12}) {
    frame.mean_depth = depth;
    frame.points = {{PointId{1}, 9, true, {1e9F, -1e9F}}, {PointId{2}, 0, true, {nan, nan}}};
    frame.trails = {{{-50, -50}, {5000, 5000}}};
    EXPECT_NO_THROW((void)overlay_.draw(frame)) << depth;
  }
}

TEST(Overlay, SmallImagesAreEnlargedToAReadableWidth) {
  const auto camera = test_camera(384, 288);
  Overlay overlay(camera);
  EXPECT_GE(overlay.size().width, 640);
  EXPECT_EQ(overlay.size().width % 2, 0);
  EXPECT_EQ(overlay.size().height % 2, 0);
  EXPECT_EQ(overlay.draw(plain_frame(*camera)).size(), overlay.size());
}

TEST(Overlay, ImagesOfAnySizeAreShownWholeOnEvenSides) {
  for (const auto& [width, height] : {std::pair(1, 1),
                                      {1, 480},
                                      {1, 4096},
                                      {2, 3},
                                      {319, 241},
                                      {639, 480},
                                      {641, 16},
                                      {1241, 376},
                                      {4095, 1}}) {
    const auto camera = test_camera(width, height);
    Overlay overlay(camera);
    auto frame = plain_frame(*camera);
    auto white = std::make_shared<GrayImage>(width, height);
    for (int y = 0; y < height; ++y) std::fill_n(white->row(y), width, uint8_t{255});
    frame.image = std::move(white);
    const cv::Mat& image = overlay.draw(frame);
    ASSERT_EQ(image.size(), overlay.size());
    EXPECT_EQ(image.cols % 2, 0);
    EXPECT_EQ(image.rows % 2, 0);
    EXPECT_LE(image.cols, std::max(64, width * overlay.scale() + 1));
    EXPECT_LE(image.rows, std::max(height, 4096) + 64);
    const cv::Rect shown(0, 0, width * overlay.scale(), height * overlay.scale());
    double darkest = 0;
    cv::minMaxLoc(image(shown).clone().reshape(1), &darkest);
    EXPECT_EQ(darkest, 255) << width << "x" << height;
  }
}

class VideoTest : public ::testing::Test {
 protected:
  /// Images in a file and its rate.
  static std::pair<int, double> read(const std::filesystem::path& path) {
    cv::VideoCapture file(path.string());
    int images = 0;
    for (cv::Mat image; file.read(image);) ++images;
    return {images, file.get(cv::CAP_PROP_FPS)};
  }

  TestDirectory own_;
  const std::filesystem::path& directory_ = own_.path();
  CameraPtr camera_ = test_camera(320, 240);
};

TEST_F(VideoTest, KeepsTimeAcrossMissingFrames) {
  for (const char* name : {"a.mp4", "a.avi", "a.mkv"}) {
    auto writer = VideoWriter::open(directory_ / name, camera_, VideoWriter::WhenBehind::kWait);
    ASSERT_TRUE(writer) << writer.error().message;
    for (const int i : {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 15, 16, 17, 18, 19})
      (*writer)->push(plain_frame(*camera_, 40 * i));
    const auto status = (*writer)->finish();
    ASSERT_TRUE(status) << status.error().message;
    const auto [images, rate] = read(directory_ / name);
    EXPECT_EQ(images, 20) << name;
    EXPECT_NEAR(rate, 25, 0.01) << name;
  }
}

TEST_F(VideoTest, FewFramesMakeAVideoAndNoneAnEmptyFile) {
  auto writer = VideoWriter::open(directory_ / "one.mp4", camera_, VideoWriter::WhenBehind::kWait);
  ASSERT_TRUE(writer);
  (*writer)->push(plain_frame(*camera_));
  ASSERT_TRUE((*writer)->finish());
  EXPECT_EQ(read(directory_ / "one.mp4").first, 1);

  auto none = VideoWriter::open(directory_ / "none.mp4", camera_, VideoWriter::WhenBehind::kWait);
  ASSERT_TRUE(none);
  EXPECT_TRUE((*none)->finish());
}

TEST_F(VideoTest, ImagesOfAnySizeMakeAVideo) {
  for (const auto& [width, height] : {std::pair(1, 1), {1, 1000}, {641, 16}, {1241, 377}, {4096, 1}}) {
    const auto camera = test_camera(width, height);
    for (const char* name : {"a.mp4", "a.avi", "a.mkv"}) {
      auto writer = VideoWriter::open(directory_ / name, camera, VideoWriter::WhenBehind::kWait);
      ASSERT_TRUE(writer);
      for (int i = 0; i < 2; ++i) (*writer)->push(plain_frame(*camera, 40 * i));
      const auto status = (*writer)->finish();
      EXPECT_TRUE(status) << width << "x" << height << ": " << status.error().message;
      EXPECT_EQ(read(directory_ / name).first, 2) << name << " " << width << "x" << height;
    }
  }
}

/// An image that is not the camera's cannot be drawn: stands for whatever OpenCV may throw.
TEST_F(VideoTest, WhatTheEncoderThrowsIsAnErrorOfTheFileAndHoldsNobodyUp) {
  auto writer = VideoWriter::open(directory_ / "a.mp4", camera_, VideoWriter::WhenBehind::kWait);
  ASSERT_TRUE(writer);
  for (int i = 0; i < 100; ++i) (*writer)->push(plain_frame(*test_camera(100, 100), 40 * i));
  const auto status = (*writer)->finish();
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, ErrorCode::kIo);
  EXPECT_NE(status.error().message.find("a.mp4"), std::string::npos) << status.error().message;
}

TEST_F(VideoTest, AJumpOfTheStampsIsACut) {
  auto writer = VideoWriter::open(directory_ / "cut.avi", camera_, VideoWriter::WhenBehind::kWait);
  ASSERT_TRUE(writer);
  for (int i = 0; i < 20; ++i) (*writer)->push(plain_frame(*camera_, 40 * i + (i < 10 ? 0 : 10'000'000)));
  ASSERT_TRUE((*writer)->finish());
  EXPECT_EQ(read(directory_ / "cut.avi").first, 20);
}

TEST_F(VideoTest, InRealtimePushNeverWaitsAndWhatIsLeftOutIsCounted) {
  auto writer = VideoWriter::open(directory_ / "busy.avi", camera_, VideoWriter::WhenBehind::kDropImages);
  ASSERT_TRUE(writer);
  constexpr int kFrames = 400;
  for (int i = 0; i < kFrames; ++i) (*writer)->push(plain_frame(*camera_, 40 * i));
  ASSERT_TRUE((*writer)->finish());
  EXPECT_GT((*writer)->images_dropped(), 0U);
  EXPECT_LT((*writer)->images_dropped(), static_cast<size_t>(kFrames));
}

TEST_F(VideoTest, AFileThatCouldNotBeWrittenToItsEndIsTold) {
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);  // writes beyond the limit fail, as on a full disk
  for (const char* name : {"a.mp4", "a.avi", "a.mkv"}) {
    auto writer = VideoWriter::open(directory_ / name, camera_, VideoWriter::WhenBehind::kWait);
    ASSERT_TRUE(writer);
    const rlimit small{100'000, before.rlim_max};
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &small), 0);
    for (int i = 0; i < 30; ++i) (*writer)->push(noise_frame(*camera_, 40 * i));
    const auto status = (*writer)->finish();
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
    ASSERT_FALSE(status) << name;
    EXPECT_EQ(status.error().code, ErrorCode::kIo);
    EXPECT_NE(status.error().message.find(name), std::string::npos) << status.error().message;
  }
  (void)std::signal(SIGXFSZ, handler);
}

TEST_F(VideoTest, AFileThatGrowsNoMoreIsToldOnceWhileTheRunGoesOn) {
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  for (const bool is_full : {true, false}) {
    std::ostringstream said;
    const auto log =
        std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(said));
    auto writer = VideoWriter::open(
        directory_ / "full.avi", camera_, VideoWriter::WhenBehind::kWait, [] { return false; }, log);
    ASSERT_TRUE(writer);
    const rlimit small{100'000, before.rlim_max};
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, is_full ? &small : &before), 0);
    for (int i = 0; i < 70; ++i) (*writer)->push(noise_frame(*camera_, 1000 * i));  // 70 s
    const auto status = (*writer)->finish();
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
    EXPECT_EQ(status.has_value(), !is_full);
    const std::string words = said.str();
    const size_t first = words.find("full.avi: does not grow any more");
    EXPECT_EQ(first != std::string::npos, is_full) << words;
    EXPECT_EQ(words.find("does not grow", first == std::string::npos ? 0 : first + 15), std::string::npos);
  }
  (void)std::signal(SIGXFSZ, handler);
}

TEST_F(VideoTest, AWrongPathIsToldAtOnce) {
  const auto ending = VideoWriter::open(directory_ / "a.gif", camera_, VideoWriter::WhenBehind::kWait);
  ASSERT_FALSE(ending);
  EXPECT_EQ(ending.error().code, ErrorCode::kUsage);
  EXPECT_NE(ending.error().message.find(".mp4"), std::string::npos);
  const auto missing =
      VideoWriter::open(directory_ / "no" / "a.mp4", camera_, VideoWriter::WhenBehind::kWait);
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, ErrorCode::kIo);
}

}  // namespace
}  // namespace cairn
