// SPDX-License-Identifier: Apache-2.0
#include "client/app/calibrate/calibrate.h"

#include <gmock/gmock.h>

#include <cstdlib>
#include <fstream>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "client/app/calibrate/test_boards.h"
#include "client/app/calibrate/view_picker.h"
#include "common/io/calibration.h"
#include "common/io/test_directory.h"

namespace cairn {
namespace {

using testing::BoardPainter;
using ::testing::HasSubstr;
using testing::make_or_fail;

constexpr unsigned kSeed = 21;
const auto kNever = [] { return false; };

/// Pictures of a vector, one a second.
class Pictures final : public FrameSource {
 public:
  explicit Pictures(std::vector<GrayImagePtr> pictures) : pictures_(std::move(pictures)) {}
  Result<std::optional<Frame>> next() override {
    if (next_ == pictures_.size()) return std::nullopt;
    const Frame frame{next_, {static_cast<int64_t>(next_) * 1'000'000'000}, pictures_[next_]};
    ++next_;
    return frame;
  }
  std::optional<size_t> frame_count() const override { return pictures_.size(); }
  std::string describe() const override { return "pictures"; }

 private:
  std::vector<GrayImagePtr> pictures_;
  size_t next_ = 0;
};

BoardDescription description_of(BoardDescription::Kind kind) {
  BoardDescription description;
  description.kind = kind;
  description.columns = 10;
  description.rows = 7;
  return description;
}

struct Case {
  std::string name;
  BoardDescription::Kind kind;
  CameraParameters truth;
};

void PrintTo(const Case& tested, std::ostream* out) {
  *out << tested.name;
}

std::vector<GrayImagePtr> paint_views(const Case& tested, int count, double noise) {
  constexpr int kSquare = 40;
  const auto camera = make_or_fail(tested.truth);
  auto drawn = draw_board(description_of(tested.kind), kSquare);
  EXPECT_TRUE(drawn) << (drawn ? "" : drawn.error().message);
  const BoardPainter painter(camera, std::move(*drawn), kSquare, kSquare);
  std::mt19937 random(kSeed);
  std::vector<GrayImagePtr> pictures;
  pictures.reserve(static_cast<size_t>(count));
  for (int i = 0; i < count; ++i) {
    pictures.push_back(painter.paint(testing::random_pose(*camera, 10, 7, 0.75, &random), noise, &random));
  }
  return pictures;
}

class RenderedBoards : public ::testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(
    All, RenderedBoards,
    ::testing::Values(
        Case{"CharucoRadtan",
             BoardDescription::Kind::kCharuco,
             {CameraModel::kPinholeRadtan, 640, 480, {520, 523, 314, 246, -0.21, 0.06, 8e-4, -5e-4}}},
        Case{"CharucoFisheye",
             BoardDescription::Kind::kCharuco,
             {CameraModel::kKannalaBrandt, 640, 480, {280, 281, 322, 237, 0.03, -0.012, 0.006, -0.001}}},
        Case{"ChessboardRadtan",
             BoardDescription::Kind::kChessboard,
             {CameraModel::kPinholeRadtan, 640, 480, {610, 608, 322, 235, 0.08, -0.1, 0, 0}}}),
    [](const auto& tested) { return tested.param.name; });

TEST_P(RenderedBoards, GiveTheCameraThatSawThem) {
  const Case& tested = GetParam();
  const auto board = make_board(description_of(tested.kind));
  ASSERT_TRUE(board) << board.error().message;
  Pictures source(paint_views(tested, 30, 2.0));
  const auto report = calibrate_from(source, **board, tested.truth.model, null_logger(), kNever);
  ASSERT_TRUE(report) << report.error().message;
  const auto& values = report->calibration.parameters.values;
  const auto& sigma = report->calibration.sigma;
  RecordProperty("rms", std::to_string(report->calibration.rms));
  EXPECT_LT(report->calibration.rms, 0.3);
  EXPECT_NE(report->verdict.grade, Grade::kPoor);
  for (size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(values[i], tested.truth.values[i], 0.003 * tested.truth.values[0])
        << i << " sigma " << sigma[i];
  }
  // Where the board was, both cameras see a ray within a fraction of a pixel.
  const auto truth = make_or_fail(tested.truth);
  const auto found = make_or_fail(report->calibration.parameters);
  for (double x = 0.15; x < 0.9; x += 0.1) {
    for (double y = 0.15; y < 0.9; y += 0.1) {
      const Eigen::Vector2d pixel(x * truth->width(), y * truth->height());
      const auto seen = found->project(truth->unproject(pixel));
      ASSERT_TRUE(seen);
      EXPECT_LT((*seen - pixel).norm(), 2) << pixel.transpose();
    }
  }
}

TEST(Calibrate, SaysWhatItSawWhenThereIsNoBoard) {
  const auto board = make_board(description_of(BoardDescription::Kind::kCharuco));
  ASSERT_TRUE(board);
  Pictures source(std::vector<GrayImagePtr>(4, std::make_shared<GrayImage>(320, 240)));
  const auto report = calibrate_from(source, **board, CameraModel::kPinholeRadtan, null_logger(), kNever);
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(report.error().message, HasSubstr("4 pictures, 0 with the ChArUco board of 10x7 squares"));
}

TEST(Calibrate, PicturesOfTwoSizesAreRefused) {
  const auto board = make_board(description_of(BoardDescription::Kind::kCharuco));
  Pictures source({std::make_shared<GrayImage>(320, 240), std::make_shared<GrayImage>(240, 320)});
  const auto report = calibrate_from(source, **board, CameraModel::kPinholeRadtan, null_logger(), kNever);
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().code, ErrorCode::kDamaged);
}

TEST(VerdictOfFewViews, IsPoorAndSaysWhereToTakeMore) {
  const Case tested{"",
                    BoardDescription::Kind::kCharuco,
                    {CameraModel::kPinholeRadtan, 640, 480, {520, 520, 320, 240, 0, 0, 0, 0}}};
  const auto camera = make_or_fail(tested.truth);
  // Four views in the upper left.
  std::vector<BoardView> views;
  for (const double tilt : {-0.4, -0.2, 0.3, 0.5}) {
    const SE3 pose(so3_exp({tilt, 0.3 - tilt, 0}), {-6, -4.5, 14});
    BoardView view;
    for (int i = 0; i < 20; ++i) {
      const Eigen::Vector3d point = Eigen::Vector3i(i % 5, i / 5, 0).cast<double>();
      const auto pixel = camera->project(pose * point);
      ASSERT_TRUE(pixel);
      view.on_board.push_back(point);
      view.pixels.push_back(*pixel + Eigen::Vector2d(0.1 * ((i * 7) % 3 - 1), 0.1 * ((i * 5) % 3 - 1)));
    }
    views.push_back(std::move(view));
  }
  const auto calibration = calibrate(CameraModel::kPinholeRadtan, {640, 480}, views);
  ASSERT_TRUE(calibration) << calibration.error().message;
  const auto verdict = judge(*calibration, views);
  EXPECT_EQ(verdict.grade, Grade::kPoor);
  EXPECT_LT(verdict.coverage, 0.5);
  EXPECT_THAT(verdict.advice, ::testing::Contains(HasSubstr("lower right")));
  EXPECT_THAT(verdict.advice, ::testing::Contains(HasSubstr("4 different sharp ones")));
}

TEST(EdgeWidth, GrowsWithBlur) {
  const Case tested{"",
                    BoardDescription::Kind::kChessboard,
                    {CameraModel::kPinholeRadtan, 640, 480, {520, 520, 320, 240, 0, 0, 0, 0}}};
  // Of some views at random places of the picture, one that shows the whole board.
  const auto board = make_board(description_of(tested.kind));
  GrayImagePtr picture;
  std::optional<BoardView> view;
  for (const GrayImagePtr& painted : paint_views(tested, 10, 0)) {
    picture = painted;
    view = (*board)->find(*picture);
    if (view) break;
  }
  ASSERT_TRUE(view);
  double last = edge_width(*picture, *view);
  EXPECT_LT(last, 4);
  for (const double sigma : {1.0, 2.0, 4.0}) {
    const cv::Mat sharp(picture->height(), picture->width(), CV_8U, const_cast<uint8_t*>(picture->row(0)),
                        static_cast<size_t>(picture->stride()));
    cv::Mat blurred;
    cv::GaussianBlur(sharp, blurred, {}, sigma);
    const double width =
        edge_width({blurred.data, blurred.cols, blurred.rows, static_cast<int>(blurred.step)}, *view);
    EXPECT_GT(width, 1.1 * last) << sigma;
    last = width;
  }
}

TEST(ViewPicker, KeepsDifferentSharpViewsOnly) {
  const auto camera = make_or_fail({CameraModel::kPinholeRadtan, 640, 480, {520, 520, 320, 240, 0, 0, 0, 0}});
  const auto view_at = [&](const SE3& pose) {
    BoardView view;
    for (int i = 0; i < 20; ++i) {
      const Eigen::Vector3d point = Eigen::Vector3i(i % 5, i / 5, 0).cast<double>();
      view.on_board.push_back(point);
      view.pixels.push_back(*camera->project(pose * point));
    }
    return view;
  };
  const SE3 first(so3_exp({0.2, 0.1, 0}), {-2, -1.5, 10});
  ViewPicker picker({640, 480});
  using Outcome = ViewPicker::Outcome;
  EXPECT_EQ(picker.offer(view_at(first), 20), Outcome::kBlurred);
  EXPECT_EQ(picker.offer(view_at(first), 4), Outcome::kKept);
  EXPECT_EQ(picker.offer(view_at(first), 4), Outcome::kLikeAnother);
  EXPECT_EQ(picker.offer(view_at(first), 3), Outcome::kReplacedABlurrierOne);
  EXPECT_EQ(picker.offer(view_at({first.rotation(), {1, -1.5, 10}}), 4), Outcome::kKept);
  EXPECT_EQ(picker.offer(view_at({first.rotation(), {-2, -1.5, 20}}), 4), Outcome::kKept);
  EXPECT_EQ(picker.offer(view_at({so3_exp({-0.4, 0.1, 0}), first.translation()}), 4), Outcome::kKept);
  EXPECT_EQ(picker.size(), 4U);
}

TEST(CalibrateOptions, AreChecked) {
  const auto text = [](std::vector<std::string> arguments) -> std::string {
    const auto parsed = parse_calibrate_options(std::move(arguments));
    const auto* exit = std::get_if<ParseExit>(&parsed);
    EXPECT_TRUE(exit != nullptr && exit->code == 2);
    return exit != nullptr ? exit->text : "";
  };
  EXPECT_THAT(text({}), HasSubstr("--board"));
  EXPECT_THAT(text({"--board", "cheese"}), HasSubstr("charuco"));
  EXPECT_THAT(text({"--board", "charuco", "--out", "a"}), HasSubstr("--squares 10x7"));
  EXPECT_THAT(text({"--board", "charuco", "--squares", "10x", "--out", "a"}), HasSubstr("--squares 10x7"));
  EXPECT_THAT(text({"--board", "charuco", "--squares", "10x7", "--out", "a"}), HasSubstr("--source"));
  EXPECT_THAT(text({"--board", "charuco", "--squares", "10x7", "--source", "a:b"}), HasSubstr("--out"));
  EXPECT_THAT(text({"--board", "tags", "--source", "a:b", "--out", "a"}), HasSubstr("--tags"));
  const auto good = parse_calibrate_options({"--source", "v4l2:/dev/video0", "--board", "chessboard",
                                             "--squares", "9x6", "--model", "kb4", "--out", "c.yaml"});
  ASSERT_TRUE(std::holds_alternative<CalibrateOptions>(good));
  EXPECT_EQ(std::get<CalibrateOptions>(good).board.columns, 9);
  EXPECT_EQ(std::get<CalibrateOptions>(good).model, CameraModel::kKannalaBrandt);
  const auto help = parse_calibrate_options({"--help"});
  EXPECT_EQ(std::get<ParseExit>(help).code, 0);
}

TEST(Boards, WrongOnesAreRefusedWithTheRemedy) {
  const auto message = [](const BoardDescription& description) {
    const auto board = make_board(description);
    EXPECT_FALSE(board);
    return board ? "" : board.error().message;
  };
  auto charuco = description_of(BoardDescription::Kind::kCharuco);
  charuco.dictionary = "7x7";
  EXPECT_THAT(message(charuco), HasSubstr("4x4_50"));
  charuco = description_of(BoardDescription::Kind::kCharuco);
  charuco.columns = 20;
  EXPECT_THAT(message(charuco), HasSubstr("the board needs 70"));
  charuco.marker = 1.5;
  EXPECT_THAT(message(charuco), HasSubstr("--marker"));
  TestDirectory directory;
  BoardDescription tags;
  tags.kind = BoardDescription::Kind::kTags;
  tags.dictionary = "apriltag_36h11";
  tags.tags = directory.path() / "tags.json";
  EXPECT_THAT(message(tags), HasSubstr("no such file"));
  for (const char* text :
       {"[]", "{}", "{\"1\": [[0,0,0]]}", "{\"1\": [[0,0,0],[1,0,0],[1,1,0],[0,1,3]]}", "{"}) {
    std::ofstream(tags.tags) << text;
    EXPECT_THAT(message(tags), HasSubstr("tags.json")) << text;
  }
}

/// Stills of a frame of AprilTags: the intrinsics that came with them are 320.45 320.08 321.20 183.16,
/// without distortion.
TEST(CalibrateRecordings, PragueBoard) {
  const char* data = std::getenv("CAIRN_DATA");
  if (data == nullptr) GTEST_SKIP() << "CAIRN_DATA is not set";
  const auto folder = std::filesystem::path(data) / "prague-board-a";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no " << folder;
  BoardDescription tags;
  tags.kind = BoardDescription::Kind::kTags;
  tags.dictionary = "apriltag_36h11";
  tags.tags = folder / "board/board_mm.json";
  const auto board = make_board(tags);
  ASSERT_TRUE(board) << board.error().message;
  auto source = open_source("tum:" + folder.string());
  ASSERT_TRUE(source) << source.error().message;
  const auto truth = read_calibration(folder / "camera.txt");
  ASSERT_TRUE(truth) << truth.error().message;
  const auto report = calibrate_from(**source, **board, CameraModel::kPinholeRadtan, null_logger(), kNever);
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_NE(report->verdict.grade, Grade::kPoor);
  for (size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(report->calibration.parameters.values[i], truth->values[i], 0.01 * truth->values[0])
        << i << " sigma " << report->calibration.sigma[i];
  }
}

}  // namespace
}  // namespace cairn
