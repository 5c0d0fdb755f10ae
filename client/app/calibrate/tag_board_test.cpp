// SPDX-License-Identifier: Apache-2.0
#include "client/app/calibrate/tag_board.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>
#include <vector>

#include "client/app/calibrate/calibrate.h"
#include "client/app/calibrate/test_boards.h"
#include "common/io/test_directory.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;
using testing::Images;
using testing::kNever;
using testing::make_or_fail;

constexpr int kColumns = 6;
constexpr int kRows = 4;
constexpr double kSpacing = 0.3;
const CameraParameters kTruth{
    CameraModel::kPinholeRadtan, 640, 480, {520, 523, 314, 246, -0.21, 0.06, 8e-4, -5e-4}};
const char* const kAprilgrid =
    "target_type: 'aprilgrid' #gridtype\ntagCols: 6\ntagRows: 4\ntagSize: 0.088\ntagSpacing: 0.3\n";

cv::Ptr<cv::aruco::Dictionary> dictionary() {
  return cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11);
}

/// A printed grid of tags, ids from the lower left, as Kalibr's.
struct PrintedTags {
  std::string name;
  int border = 1;        ///< [bits]
  bool squares = false;  ///< black ones between the tags, corner to corner
  int turn = 0;          ///< of each tag where it stands [quarters]
  double blur = 0;       ///< of the images [px]
};

void PrintTo(const PrintedTags& tested, std::ostream* out) {
  *out << tested.name;
}

/// Its image; a tag's side is one unit, and the upper left corner of the upper left tag at (0, 0).
struct Drawing {
  GrayImage image;
  int side = 0;    ///< [px]
  int margin = 0;  ///< [px]
};

Drawing draw(const PrintedTags& printed) {
  constexpr int kBits = 6;
  constexpr int kBitPixels = 10;
  const int side = (kBits + 2 * printed.border) * kBitPixels;
  const int gap = static_cast<int>(std::lround(kSpacing * side));
  const int pitch = side + gap;
  const int margin = side;
  cv::Mat drawn(kRows * pitch + 2 * margin, kColumns * pitch + 2 * margin, CV_8U, cv::Scalar(255));
  for (int row = 0; row <= kRows; ++row) {
    for (int column = 0; column <= kColumns; ++column) {
      const cv::Point corner(margin + column * pitch, margin + row * pitch);
      if (printed.squares) drawn(cv::Rect(corner - cv::Point(gap, gap), cv::Size(gap, gap))) = 0;
      if (row == kRows || column == kColumns) continue;
      cv::Mat tag;
      cv::aruco::drawMarker(dictionary(), (kRows - 1 - row) * kColumns + column, side, tag, printed.border);
      for (int i = 0; i < printed.turn; ++i) cv::rotate(tag, tag, cv::ROTATE_90_CLOCKWISE);
      tag.copyTo(drawn(cv::Rect(corner, tag.size())));
    }
  }
  return {GrayImage(GrayView{drawn.data, drawn.cols, drawn.rows, static_cast<int>(drawn.step)}), side,
          margin};
}

std::vector<GrayImagePtr> paint(const PrintedTags& printed, int count) {
  constexpr unsigned kSeed = 7;
  constexpr double kNoise = 2;
  constexpr double kTilt = 0.7;
  const auto camera = make_or_fail(kTruth);
  auto drawing = draw(printed);
  const testing::BoardPainter painter(camera, std::move(drawing.image), drawing.side, drawing.margin);
  std::mt19937 random(kSeed);
  std::vector<GrayImagePtr> images;
  for (int i = 0; i < count; ++i) {
    const SE3 pose = testing::random_pose(*camera, kColumns * (1 + kSpacing) - kSpacing,
                                          kRows * (1 + kSpacing) - kSpacing, kTilt, &random);
    const double noise = printed.blur > 0 ? 0 : kNoise;
    auto image = std::make_shared<GrayImage>(painter.paint(pose, noise, &random)->view());
    if (printed.blur > 0) {
      cv::Mat pixels(image->height(), image->width(), CV_8U, image->row(0),
                     static_cast<size_t>(image->stride()));
      cv::GaussianBlur(pixels, pixels, {}, printed.blur);
    }
    images.push_back(std::move(image));
  }
  return images;
}

class TagFiles : public ::testing::Test {
 protected:
  std::filesystem::path write(const std::string& name, const std::string& content) const {
    const auto path = directory_.path() / name;
    std::ofstream(path) << content;
    return path;
  }
  /// The JSON that says what the plan does.
  std::filesystem::path write_corners(const TagPlan& plan) const {
    nlohmann::json json;
    for (const auto& [id, corners] : plan.tags) {
      auto& list = json[std::to_string(id)];
      for (const auto& corner : corners) list.push_back({corner.x(), corner.y(), 0});
    }
    return write("tags.json", json.dump());
  }
  static BoardDescription described(const std::filesystem::path& tags) {
    BoardDescription description;
    description.kind = BoardDescription::Kind::kTags;
    description.dictionary = "apriltag_36h11";
    description.tags = tags;
    return description;
  }
  std::string why_not(const std::string& content) const {
    const auto plan = read_tag_plan(write("wrong.yaml", content));
    EXPECT_FALSE(plan);
    return plan ? "" : plan.error().message;
  }

 private:
  TestDirectory directory_;
};

TEST_F(TagFiles, KalibrsGridBeginsInTheLowerLeftAndGoesUp) {
  const auto plan = read_tag_plan(write("april.yaml", kAprilgrid));
  ASSERT_TRUE(plan) << plan.error().message;
  ASSERT_EQ(plan->tags.size(), 24U);
  EXPECT_EQ(plan->border, 2);
  const auto upper_left = [&](int id) { return plan->tags.at(id)[0]; };
  constexpr double kPitch = 0.088 * 1.3;
  EXPECT_LT((upper_left(1) - upper_left(0) - Eigen::Vector3d(kPitch, 0, 0)).norm(), 1e-12);
  EXPECT_LT((upper_left(6) - upper_left(0) - Eigen::Vector3d(0, -kPitch, 0)).norm(), 1e-12);
  for (const auto& [id, corners] : plan->tags) {
    EXPECT_LT((corners[2] - corners[0] - Eigen::Vector3d(0.088, 0.088, 0)).norm(), 1e-12) << id;
    EXPECT_LT((corners[3] - corners[1] - Eigen::Vector3d(-0.088, 0.088, 0)).norm(), 1e-12) << id;
  }
}

TEST_F(TagFiles, WrongOnesAreRefusedWithWhatIsExpected) {
  EXPECT_THAT(why_not("target_type: 'checkerboard'\n"), HasSubstr("--board chessboard"));
  EXPECT_THAT(why_not("target_type: 'circlegrid'\n"), HasSubstr("'circlegrid'"));
  EXPECT_THAT(why_not("target_type: 'aprilgrid'\n"), HasSubstr("tagCols"));
  EXPECT_THAT(why_not("target_type: aprilgrid\ntagCols: 6\ntagRows: 1000\n"), HasSubstr("tagRows"));
  EXPECT_THAT(why_not("target_type: aprilgrid\ntagCols: 6\ntagRows: 6\ntagSize: -1\n"), HasSubstr("tagSize"));
  EXPECT_THAT(why_not("target_type: aprilgrid\ntagCols: 6\ntagRows: 6\ntagSize: 1\ntagSpacing: x\n"),
              HasSubstr("tagSpacing"));
  EXPECT_THAT(why_not("target_type: [\n"), HasSubstr("wrong.yaml"));
  EXPECT_THAT(why_not("tagCols: 6\n"), HasSubstr("aprilgrid"));
}

class RenderedTags : public TagFiles, public ::testing::WithParamInterface<PrintedTags> {};
INSTANTIATE_TEST_SUITE_P(All, RenderedTags,
                         ::testing::Values(PrintedTags{"Ordinary"}, PrintedTags{"Blurred", 1, false, 0, 1.5},
                                           PrintedTags{"Kalibrs", 2, true},
                                           PrintedTags{"KalibrsBlurred", 2, true, 0, 1.5},
                                           PrintedTags{"TurnedHalfWay", 2, true, 2},
                                           PrintedTags{"TurnedLeft", 1, false, 3}),
                         [](const auto& tested) { return tested.param.name; });

/// By Kalibr's yaml and by a list of corners alike, whatever the border.
TEST_P(RenderedTags, GiveTheCameraThatSawThem) {
  constexpr int kViews = 14;
  const auto images = paint(GetParam(), kViews);
  const auto yaml = write("april.yaml", kAprilgrid);
  for (const auto& file : {yaml, write_corners(read_tag_plan(yaml).value())}) {
    const auto board = make_board(described(file));
    ASSERT_TRUE(board) << board.error().message;
    Images source(images);
    const auto report = calibrate_from(source, **board, kTruth.model, null_logger(), kNever);
    ASSERT_TRUE(report) << report.error().message;
    EXPECT_LT(report->calibration.rms, GetParam().blur > 0 ? 0.2 : 0.1);
    EXPECT_EQ(report->found, kViews);
    EXPECT_NE(report->verdict.grade, Grade::kPoor);
    for (size_t i = 0; i < 4; ++i)
      EXPECT_NEAR(report->calibration.parameters.values[i], kTruth.values[i], 1.0) << i;
  }
}

/// OpenCV's corners, to compare with.
class TagsOfOpenCv final : public Board {
 public:
  TagsOfOpenCv(TagPlan plan, int refinement) : plan_(std::move(plan)), refinement_(refinement) {}
  std::optional<BoardView> find(const GrayView& image) const override {
    const auto parameters = cv::aruco::DetectorParameters::create();
    parameters->markerBorderBits = plan_.border;
    parameters->cornerRefinementMethod = refinement_;
    const cv::Mat pixels(image.height, image.width, CV_8U, const_cast<uint8_t*>(image.data),
                         static_cast<size_t>(image.stride));
    std::vector<std::vector<cv::Point2f>> found;
    std::vector<int> ids;
    cv::aruco::detectMarkers(pixels, dictionary(), found, ids, parameters);
    BoardView view;
    for (size_t i = 0; i < ids.size(); ++i) {
      if (!plan_.tags.contains(ids[i])) continue;
      for (size_t k = 0; k < 4; ++k) {
        view.on_board.push_back(plan_.tags.at(ids[i])[k]);
        view.pixels.emplace_back(found[i][k].x, found[i][k].y);
      }
    }
    return view.size() < 8 ? std::nullopt : std::optional(std::move(view));
  }
  std::string describe() const override { return "tags"; }

 private:
  TagPlan plan_;
  int refinement_;
};

/// rms [px]; infinite where there is no calibration.
double rms_of(const Board& board, const std::vector<GrayImagePtr>& images) {
  Images source(images);
  const auto report = calibrate_from(source, board, CameraModel::kPinholeRadtan, null_logger(), kNever);
  return report ? report->calibration.rms : std::numeric_limits<double>::infinity();
}

/// Ours first, then OpenCV's.
using RmsByCorners = std::array<double, 5>;

/// Prints a row of the README's table.
RmsByCorners measure(const std::string& name, const TagPlan& plan, const std::vector<GrayImagePtr>& images) {
  RmsByCorners rms = {rms_of(TagBoard(name, plan, dictionary()), images)};
  size_t next = 1;
  for (const int refinement : {cv::aruco::CORNER_REFINE_APRILTAG, cv::aruco::CORNER_REFINE_SUBPIX,
                               cv::aruco::CORNER_REFINE_CONTOUR, cv::aruco::CORNER_REFINE_NONE})
    rms[next++] = rms_of(TagsOfOpenCv(plan, refinement), images);
  std::printf("| %s |", name.c_str());
  for (const double value : rms) std::printf(" %.2f |", value);
  std::printf("\n");
  return rms;
}

/// Each of OpenCV's is worse somewhere than ours are anywhere.
TEST_F(TagFiles, OurCornersAreBetterThanAnyOfOpenCvs) {
  constexpr int kViews = 8;
  const auto plan = read_tag_plan(write("april.yaml", kAprilgrid));
  ASSERT_TRUE(plan);
  RmsByCorners worst{};
  for (const PrintedTags& printed :
       {PrintedTags{"ordinary"}, PrintedTags{"ordinary, blur of 1.5 px", 1, false, 0, 1.5},
        PrintedTags{"Kalibr's", 2, true}, PrintedTags{"Kalibr's, blur of 1.5 px", 2, true, 0, 1.5}}) {
    TagPlan known = *plan;
    known.border = printed.border;
    const auto rms = measure(printed.name, known, paint(printed, kViews));
    for (size_t i = 0; i < rms.size(); ++i) worst[i] = std::max(worst[i], rms[i]);
  }
  for (size_t i = 1; i < worst.size(); ++i) EXPECT_GT(worst[i], 1.5 * worst[0]) << i;
}

TEST_F(TagFiles, OurCornersAreBetterThanAnyOfOpenCvsOnPaper) {
  const char* data = std::getenv("CAIRN_DATA");
  if (data == nullptr) GTEST_SKIP() << "CAIRN_DATA is not set";
  const auto folder = std::filesystem::path(data) / "prague-board-a";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no " << folder;
  const auto plan = read_tag_plan(folder / "board/board_mm.json");
  ASSERT_TRUE(plan) << plan.error().message;
  auto source = open_source("tum:" + folder.string());
  ASSERT_TRUE(source) << source.error().message;
  std::vector<GrayImagePtr> images;
  constexpr size_t kEvery = 4;
  for (auto frame = (*source)->next(); frame && *frame; frame = (*source)->next()) {
    if ((*frame)->index % kEvery == 0) images.push_back((*frame)->image);
  }
  const auto rms = measure("prague-board-a, every fourth image", *plan, images);
  EXPECT_EQ(std::min_element(rms.begin(), rms.end()), rms.begin());
}

}  // namespace
}  // namespace cairn
