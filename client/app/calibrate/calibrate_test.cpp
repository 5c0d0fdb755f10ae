// SPDX-License-Identifier: Apache-2.0
#include "client/app/calibrate/calibrate.h"

#include <gmock/gmock.h>
#include <spdlog/sinks/ostream_sink.h>

#include <cstdlib>
#include <fstream>
#include <limits>
#include <opencv2/aruco.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <sstream>
#include <utility>

#include "client/app/calibrate/test_boards.h"
#include "client/app/calibrate/view_picker.h"
#include "common/io/calibration.h"
#include "common/io/test_directory.h"
#include "common/io/text.h"

namespace cairn {
namespace {

using testing::BoardPainter;
using ::testing::HasSubstr;
using testing::Images;
using testing::kNever;
using testing::make_or_fail;

constexpr unsigned kSeed = 21;

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
  std::vector<GrayImagePtr> images;
  images.reserve(static_cast<size_t>(count));
  for (int i = 0; i < count; ++i) {
    images.push_back(painter.paint(testing::random_pose(*camera, 10, 7, 0.75, &random), noise, &random));
  }
  return images;
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
             {CameraModel::kPinholeRadtan, 640, 480, {410, 408, 322, 235, 0.08, -0.1, 0, 0}}},
        Case{"ChessboardFisheye",
             BoardDescription::Kind::kChessboard,
             {CameraModel::kKannalaBrandt, 640, 480, {280, 281, 322, 237, 0.03, -0.012, 0.006, -0.001}}}),
    [](const auto& tested) { return tested.param.name; });

TEST_P(RenderedBoards, GiveTheCameraThatSawThem) {
  const Case& tested = GetParam();
  const auto board = make_board(description_of(tested.kind));
  ASSERT_TRUE(board) << board.error().message;
  Images source(paint_views(tested, 30, 2.0));
  const auto report = calibrate_from(source, **board, tested.truth.model, null_logger(), kNever);
  ASSERT_TRUE(report) << report.error().message;
  const auto& values = report->calibration.parameters.values;
  const auto& sigma = report->calibration.sigma;
  RecordProperty("rms", std::to_string(report->calibration.rms));
  EXPECT_LT(report->calibration.rms, 0.3);
  EXPECT_NE(report->verdict.grade, Grade::kPoor);
  for (size_t i = 0; i < 4; ++i) EXPECT_NEAR(values[i], tested.truth.values[i], 4 * sigma[i]) << i;
  // What shifts all corners alike shifts the principal point; sigma does not tell.
  for (size_t i = 2; i < 4; ++i) EXPECT_NEAR(values[i], tested.truth.values[i], 0.2) << i;
  // Where the board was, both cameras see a ray within a fraction of a pixel.
  const auto truth = make_or_fail(tested.truth);
  const auto found = make_or_fail(report->calibration.parameters);
  for (double x = 0.15; x < 0.9; x += 0.1) {
    for (double y = 0.15; y < 0.9; y += 0.1) {
      const Eigen::Vector2d pixel(x * truth->width(), y * truth->height());
      const auto seen = found->project(truth->unproject(pixel));
      ASSERT_TRUE(seen);
      EXPECT_LT((*seen - pixel).norm(), 0.3) << pixel.transpose();
    }
  }
}

/// A board of OpenCV before 4.6, and of calib.io: the square in the lower left is black, whatever the rows.
GrayImage draw_older_charuco(const BoardDescription& description, int square_px) {
  const auto dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_4X4_50);
  const int marker_px = static_cast<int>(description.marker * square_px);
  cv::Mat image((description.rows + 2) * square_px, (description.columns + 2) * square_px, CV_8U,
                cv::Scalar(255));
  int id = 0;
  for (int y = 0; y < description.rows; ++y) {
    for (int x = 0; x < description.columns; ++x) {
      const cv::Point corner((x + 1) * square_px, (y + 1) * square_px);
      if ((x + description.rows - 1 - y) % 2 == 0) {
        image(cv::Rect(corner, cv::Size(square_px, square_px))).setTo(0);
        continue;
      }
      cv::Mat marker;
      cv::aruco::drawMarker(dictionary, id++, marker_px, marker);
      const int gap = (square_px - marker_px) / 2;
      marker.copyTo(image(cv::Rect(corner + cv::Point(gap, gap), marker.size())));
    }
  }
  return GrayImage(GrayView{image.data, image.cols, image.rows, static_cast<int>(image.step)});
}

struct PrintedBoard {
  std::string name;
  BoardDescription description;
  bool older = false;
  double sign = 1;  ///< -1: Board numbers it upside down
};

void PrintTo(const PrintedBoard& tested, std::ostream* out) {
  *out << tested.name;
}

BoardDescription charuco_of(int columns, int rows, std::string dictionary = "4x4_50") {
  BoardDescription description = description_of(BoardDescription::Kind::kCharuco);
  description.columns = columns;
  description.rows = rows;
  description.dictionary = std::move(dictionary);
  return description;
}

class FoundCorners : public ::testing::TestWithParam<PrintedBoard> {};
INSTANTIATE_TEST_SUITE_P(All, FoundCorners,
                         ::testing::Values(PrintedBoard{"Chessboard",
                                                        description_of(BoardDescription::Kind::kChessboard),
                                                        false, -1},
                                           PrintedBoard{"Charuco", charuco_of(10, 7)},
                                           PrintedBoard{"LargeCharuco", charuco_of(12, 9, "5x5_100")},
                                           PrintedBoard{"CharucoOfEvenRows", charuco_of(9, 6)},
                                           PrintedBoard{"OlderCharucoOfEvenRows", charuco_of(9, 6), true},
                                           PrintedBoard{"OlderCharucoOfEvenSides", charuco_of(10, 8), true},
                                           PrintedBoard{"OlderCharucoOfOddRows", charuco_of(10, 7), true}),
                         [](const auto& tested) { return tested.param.name; });

/// How far off the corners of a view are, with the origin at whatever crossing fits the first.
std::vector<Eigen::Vector2d> errors_of(const BoardView& view, const PrintedBoard& tested, const SE3& pose,
                                       const Camera& camera) {
  const auto seen_at = [&](const Eigen::Vector2d& on_board) {
    return camera.project(pose * Eigen::Vector3d(on_board.x(), on_board.y(), 0)).value();
  };
  Eigen::Vector2d origin(0, 0);
  double nearest = std::numeric_limits<double>::max();
  for (int y = 1; y < tested.description.rows; ++y) {
    for (int x = 1; x < tested.description.columns; ++x) {
      const Eigen::Vector2d crossing(x, y);
      const double distance = (view.pixels[0] - seen_at(crossing)).norm();
      if (distance >= nearest) continue;
      nearest = distance;
      origin = crossing - tested.sign * view.on_board[0].head<2>();
    }
  }
  std::vector<Eigen::Vector2d> errors;
  for (size_t i = 0; i < view.size(); ++i)
    errors.emplace_back(view.pixels[i] - seen_at(origin + tested.sign * view.on_board[i].head<2>()));
  return errors;
}

TEST_P(FoundCorners, LieWhereTheyAreSeen) {
  constexpr int kSquare = 40;
  constexpr int kViews = 8;
  const PrintedBoard& tested = GetParam();
  const int columns = tested.description.columns;
  const int rows = tested.description.rows;
  const auto camera =
      make_or_fail({CameraModel::kPinholeRadtan, 640, 480, {520, 523, 314, 246, -0.21, 0.06, 8e-4, -5e-4}});
  const auto board = make_board(tested.description);
  ASSERT_TRUE(board) << board.error().message;
  auto drawn = tested.older ? draw_older_charuco(tested.description, kSquare)
                            : draw_board(tested.description, kSquare).value();
  const BoardPainter painter(camera, std::move(drawn), kSquare, kSquare);
  std::mt19937 random(kSeed);
  Eigen::Vector2d sum(0, 0);
  int corners = 0;
  for (int i = 0; i < kViews; ++i) {
    const SE3 pose = testing::random_pose(*camera, columns, rows, 0.75, &random);
    const auto view = (*board)->find(*painter.paint(pose, 2.0, &random));
    if (!view) continue;
    for (const auto& error : errors_of(*view, tested, pose, *camera)) {
      EXPECT_LT(error.norm(), 1.5);
      sum += error;
      ++corners;
    }
  }
  EXPECT_GT(corners, kViews * (columns - 1) * (rows - 1) / 2);
  EXPECT_LT(sum.norm() / corners, 0.03) << sum.transpose() / corners;
}

/// The command, with a folder of images of a board.
class CalibrateCommand : public ::testing::Test {
 protected:
  CalibrateCommand() {
    const auto images = directory_.path() / "images";
    std::filesystem::create_directory(images);
    std::filesystem::create_directory(directory_.path() / "out");
    const Case tested{"",
                      BoardDescription::Kind::kCharuco,
                      {CameraModel::kPinholeRadtan, 640, 480, {520, 520, 320, 240, 0, 0, 0, 0}}};
    for (const auto& image : paint_views(tested, kImages, 2)) {
      const cv::Mat pixels(image->height(), image->width(), CV_8U, const_cast<uint8_t*>(image->row(0)),
                           static_cast<size_t>(image->stride()));
      cv::imwrite((images / (std::to_string(10 + written_++) + ".png")).string(), pixels);
    }
    options_.source = "images:" + images.string() + "?fps=1";
    options_.board = description_of(BoardDescription::Kind::kCharuco);
    options_.out = directory_.path() / "out" / "camera.yaml";
  }

  /// What it says, and its exit code.
  std::pair<std::string, int> run(const std::function<bool()>& stop_requested) const {
    std::ostringstream said;
    const auto log =
        std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::ostream_sink_mt>(said));
    const int code = run_calibrate(options_, log, stop_requested);
    return {said.str(), code};
  }

  static constexpr int kImages = 12;
  TestDirectory directory_;
  CalibrateOptions options_;

 private:
  int written_ = 0;
};

TEST_F(CalibrateCommand, WritesWhatItFound) {
  const auto [said, code] = run(kNever);
  EXPECT_EQ(code, 0) << said;
  EXPECT_TRUE(read_calibration(options_.out)) << said;
}

TEST_F(CalibrateCommand, TellsAtOnceThatTheFileCannotBeWritten) {
  options_.out = directory_.path() / "nowhere" / "camera.yaml";
  int looks = 0;
  const auto [said, code] = run([&] { return ++looks > kImages; });
  EXPECT_EQ(code, 3);
  EXPECT_EQ(looks, 0);
  EXPECT_THAT(said, HasSubstr(options_.out.string() + ": cannot be written"));
  EXPECT_THAT(said, HasSubstr("pass another --out"));
  options_.out = directory_.path();
  EXPECT_EQ(run(kNever).second, 3);
}

TEST_F(CalibrateCommand, LeavesAnOldFileUntilItHasANewOne) {
  std::ofstream(options_.out) << "old";
  EXPECT_EQ(run([] { return true; }).second, 1);
  EXPECT_EQ(read_file(options_.out).value(), "old");
}

TEST_F(CalibrateCommand, PrintsWhatItCannotWrite) {
  int looks = 0;
  const auto folder = options_.out.parent_path();
  ::testing::internal::CaptureStdout();
  const auto [said, code] = run([&] {
    if (++looks == kImages) std::filesystem::remove_all(folder);
    return false;
  });
  const std::string printed = ::testing::internal::GetCapturedStdout();
  EXPECT_EQ(code, 3);
  EXPECT_THAT(said, HasSubstr(options_.out.string() + ": cannot be written"));
  EXPECT_THAT(said, HasSubstr("stdout"));
  EXPECT_THAT(said, ::testing::Not(HasSubstr(".part")));
  const auto saved = directory_.path() / "saved.yaml";
  std::ofstream(saved) << printed;
  const auto read = read_calibration(saved);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_NEAR(read->values[0], 520, 2);
}

TEST(Calibrate, SaysWhatItSawWhenThereIsNoBoard) {
  const auto board = make_board(description_of(BoardDescription::Kind::kCharuco));
  ASSERT_TRUE(board);
  Images source(std::vector<GrayImagePtr>(4, std::make_shared<GrayImage>(320, 240)));
  const auto report = calibrate_from(source, **board, CameraModel::kPinholeRadtan, null_logger(), kNever);
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().code, ErrorCode::kDegenerate);
  EXPECT_THAT(report.error().message, HasSubstr("4 images, 0 with the ChArUco board of 10x7 squares"));
}

TEST(Calibrate, ImagesOfTwoSizesAreRefused) {
  const auto board = make_board(description_of(BoardDescription::Kind::kCharuco));
  Images source({std::make_shared<GrayImage>(320, 240), std::make_shared<GrayImage>(240, 320)});
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
  // Of some views at random places of the image, one that shows the whole board.
  const auto board = make_board(description_of(tested.kind));
  GrayImagePtr image;
  std::optional<BoardView> view;
  for (const GrayImagePtr& painted : paint_views(tested, 10, 0)) {
    image = painted;
    view = (*board)->find(*image);
    if (view) break;
  }
  ASSERT_TRUE(view);
  double last = edge_width(*image, *view);
  EXPECT_LT(last, 4);
  for (const double sigma : {1.0, 2.0, 4.0}) {
    const cv::Mat sharp(image->height(), image->width(), CV_8U, const_cast<uint8_t*>(image->row(0)),
                        static_cast<size_t>(image->stride()));
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
  EXPECT_THAT(text({"--bord", "charuco"}), HasSubstr("unknown argument '--bord'; did you mean --board?"));
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
  const auto version = parse_calibrate_options({"--version"});
  EXPECT_EQ(std::get<ParseExit>(version).code, 0);
  EXPECT_THAT(std::get<ParseExit>(version).text, ::testing::StartsWith("cairn-track "));
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
  std::ofstream(tags.tags) << std::string("\xff\xfe{\0", 4);
  EXPECT_THAT(message(tags), HasSubstr("tags.json: is UTF-16 text"));
  std::ofstream(tags.tags) << "\xef\xbb\xbf{\"1\": [[0,0,0],[1,0,0],[1,1,0],[0,1,0]]}";
  EXPECT_TRUE(make_board(tags));
}

/// Stills of a frame of AprilTags: the intrinsics that came with them are 320.45 320.08 321.20 183.16,
/// without distortion. The paper is not quite flat.
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
  EXPECT_EQ(report->verdict.grade, Grade::kGood);
  EXPECT_LT(report->calibration.rms, 0.25);
  for (size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(report->calibration.parameters.values[i], truth->values[i], 0.003 * truth->values[0])
        << i << " sigma " << report->calibration.sigma[i];
  }
}

}  // namespace
}  // namespace cairn
