// SPDX-License-Identifier: Apache-2.0
#include "client/app/label_view.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "client/app/label_painter.h"

namespace cairn {
namespace {

constexpr unsigned kSeed = 1847;

CameraPtr test_camera() {
  return *make_camera({CameraModel::kPinholeRadtan, 640, 480, {500, 500, 319.5, 239.5, -0.2, 0.05, 0, 0, 0}});
}

/// n^T p = d, camera frame.
struct Plane {
  Eigen::Vector3d normal;
  double offset;
  [[nodiscard]] std::optional<Eigen::Vector3d> hit(const Eigen::Vector3d& ray) const {
    const double distance = offset / normal.dot(ray);
    return distance > 0 ? std::optional<Eigen::Vector3d>(distance * ray) : std::nullopt;
  }
};

/// A plane one to three units away, turned by at most 50 degrees.
Plane random_plane(std::mt19937* random) {
  std::uniform_real_distribution<double> unit(-1, 1);
  const Eigen::AngleAxisd turn(0.87 * unit(*random),
                               Eigen::Vector3d(unit(*random), unit(*random), 0.1).normalized());
  const Eigen::Vector3d normal = turn * -Eigen::Vector3d::UnitZ();
  return {normal, normal.dot(Eigen::Vector3d(0, 0, 2 + unit(*random)))};
}

std::vector<PointInView> points_on(const Plane& plane, const Camera& camera, const cv::Rect& where, int count,
                                   std::mt19937* random) {
  std::vector<PointInView> points;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector2d pixel(
        std::uniform_real_distribution<double>(where.x, where.x + where.width)(*random),
        std::uniform_real_distribution<double>(where.y, where.y + where.height)(*random));
    if (const auto place = plane.hit(camera.unproject(pixel))) points.push_back({pixel, *place});
  }
  return points;
}

Label label_at(uint64_t id, const Eigen::Vector3d& place) {
  Label label;
  label.id = {id};
  label.text = "label " + std::to_string(id);
  label.map_from_label = SE3(Eigen::Quaterniond::Identity(), place);
  return label;
}

class LabelViewTest : public ::testing::Test {
 protected:
  [[nodiscard]] std::vector<LabelInView> view(const Eigen::Vector3d& place,
                                              const std::vector<PointInView>& seen) const {
    return labels_in_view({label_at(1, place)}, SE3(), *camera_, seen);
  }

  std::mt19937 random_{kSeed};
  CameraPtr camera_ = test_camera();
  TextPainter painter_;
  const cv::Rect everywhere_{0, 0, 639, 479};
};

TEST_F(LabelViewTest, ALabelStandsWhereItsPlaceProjectsWhateverTheMapsFrame) {
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector2d pixel(std::uniform_real_distribution<double>(0, 639)(random_),
                                std::uniform_real_distribution<double>(0, 479)(random_));
    const SE3 camera_from_map = SE3::exp(Vector6d::Random());
    const Eigen::Vector3d place = camera_from_map.inverse() * (1.7 * camera_->unproject(pixel));
    const auto shown = labels_in_view({label_at(1, place)}, camera_from_map, *camera_, {});
    ASSERT_EQ(shown.size(), 1U);
    EXPECT_LT((shown[0].pixel - pixel).norm(), 1e-4);
    EXPECT_NEAR(shown[0].distance, 1.7, 1e-9);
    EXPECT_FALSE(shown[0].hidden) << "nothing is known to stand before it";
  }
}

TEST_F(LabelViewTest, OutsideTheViewAndBehindTheCameraThereIsNone) {
  EXPECT_TRUE(view({0, 0, -2}, {}).empty());
  EXPECT_TRUE(view({5, 0, 2}, {}).empty());
  EXPECT_TRUE(view({0, -5, 2}, {}).empty());
  EXPECT_EQ(view({0, 0, 2}, {}).size(), 1U);
}

TEST_F(LabelViewTest, ALabelOnASurfaceIsNotHiddenByItHoweverItIsTurned) {
  for (int i = 0; i < 200; ++i) {
    SCOPED_TRACE(::testing::Message() << "seed " << kSeed << ", plane " << i);
    const Plane plane = random_plane(&random_);
    const auto seen = points_on(plane, *camera_, everywhere_, 800, &random_);
    const Eigen::Vector2d pixel(std::uniform_real_distribution<double>(20, 620)(random_),
                                std::uniform_real_distribution<double>(20, 460)(random_));
    const auto place = plane.hit(camera_->unproject(pixel));
    if (!place || place->norm() > 8) continue;
    const auto shown = view(*place, seen);
    ASSERT_EQ(shown.size(), 1U);
    EXPECT_FALSE(shown[0].hidden);
  }
}

TEST_F(LabelViewTest, ALabelBehindASurfaceIsHiddenAndOneBeforeItIsNot) {
  for (int i = 0; i < 200; ++i) {
    SCOPED_TRACE(::testing::Message() << "seed " << kSeed << ", plane " << i);
    const Plane plane = random_plane(&random_);
    const auto seen = points_on(plane, *camera_, everywhere_, 3000, &random_);
    const Eigen::Vector2d pixel(std::uniform_real_distribution<double>(40, 600)(random_),
                                std::uniform_real_distribution<double>(40, 440)(random_));
    const auto place = plane.hit(camera_->unproject(pixel));
    if (!place || place->norm() > 8) continue;
    const auto behind = view(1.5 * *place, seen);
    ASSERT_EQ(behind.size(), 1U);
    EXPECT_TRUE(behind[0].hidden);
    EXPECT_FALSE(view(0.7 * *place, seen).at(0).hidden);
  }
}

TEST_F(LabelViewTest, OneStrayPointHidesNothing) {
  const Eigen::Vector3d place(0, 0, 2);
  std::vector<PointInView> seen{{{319, 239}, {0, 0, 1}}};
  EXPECT_FALSE(view(place, seen)[0].hidden);
  seen.push_back({{321, 241}, {0, 0, 1}});
  EXPECT_TRUE(view(place, seen)[0].hidden);
  for (const double x : {315.0, 325.0}) seen.push_back({{x, 239}, {0, 0, 2}});
  EXPECT_FALSE(view(place, seen)[0].hidden) << "as many points are at its own depth";
}

TEST_F(LabelViewTest, TheFarthestComesFirst) {
  const std::vector<Label> labels{label_at(1, {0, 0, 1}), label_at(2, {0, 0, 3}), label_at(3, {0, 0, 2})};
  const auto shown = labels_in_view(labels, SE3(), *camera_, {});
  ASSERT_EQ(shown.size(), 3U);
  EXPECT_EQ(shown[0].label.id, LabelId{2});
  EXPECT_EQ(shown[2].label.id, LabelId{1});
}

TEST_F(LabelViewTest, WhoPointsNextToAPointMeansThatPoint) {
  for (int i = 0; i < 100; ++i) {
    SCOPED_TRACE(::testing::Message() << "seed " << kSeed << ", plane " << i);
    const auto seen = points_on(random_plane(&random_), *camera_, everywhere_, 300, &random_);
    const PointInView& meant = seen[random_() % seen.size()];
    const auto place = pick_place(meant.pixel + Eigen::Vector2d(0.2, -0.2), *camera_, seen);
    ASSERT_TRUE(place.has_value());
    const auto is_as_near = [&](const PointInView& p) {
      return p.position == *place && (p.pixel - meant.pixel).norm() < 1;
    };
    EXPECT_TRUE(std::any_of(seen.begin(), seen.end(), is_as_near));
  }
}

TEST_F(LabelViewTest, BetweenPointsTheSurfaceIsMeant) {
  for (int i = 0; i < 200; ++i) {
    SCOPED_TRACE(::testing::Message() << "seed " << kSeed << ", plane " << i);
    const Plane plane = random_plane(&random_);
    auto seen = points_on(plane, *camera_, everywhere_, 600, &random_);
    const Eigen::Vector2d pixel(std::uniform_real_distribution<double>(60, 580)(random_),
                                std::uniform_real_distribution<double>(60, 420)(random_));
    std::erase_if(seen, [&](const PointInView& p) { return (p.pixel - pixel).norm() < 20; });
    const auto truth = plane.hit(camera_->unproject(pixel));
    if (!truth || truth->norm() > 8) continue;
    const auto place = pick_place(pixel, *camera_, seen);
    ASSERT_TRUE(place.has_value());
    EXPECT_LT((*place - *truth).norm(), 1e-6 * truth->norm());
  }
}

/// A dozen points in a line, good to half a percent, leave a plane free to tilt about them; a few more,
/// farther away, do not.
TEST_F(LabelViewTest, PointsInALineToOneSideTellNoPlane) {
  std::uniform_real_distribution<double> noise(-0.005, 0.005);
  for (int i = 0; i < 50; ++i) {
    SCOPED_TRACE(::testing::Message() << "seed " << kSeed << ", " << i);
    const Plane desk = random_plane(&random_);
    std::vector<PointInView> seen;
    const auto add = [&](double x, double y) {
      const auto hit = desk.hit(camera_->unproject({x, y}));
      if (hit) seen.push_back({{x, y}, (1 + noise(random_)) * *hit});
    };
    for (int k = 0; k < 12; ++k) add(260 + 0.5 * (k % 3), 240 - 5 * k);
    for (int k = 0; k < 12; ++k) add(390 + 3 * (k % 3), 150 + 4 * k);
    const auto truth = desk.hit(camera_->unproject({320, 240}));
    if (seen.size() < 24 || !truth || truth->norm() > 8) continue;
    const auto place = pick_place({320, 240}, *camera_, seen);
    ASSERT_TRUE(place.has_value());
    EXPECT_LT((*place - *truth).norm(), 0.03 * truth->norm());
  }
}

TEST_F(LabelViewTest, ASurfaceFarBehindTheOneThatIsMeantDoesNotCount) {
  const Plane desk{-Eigen::Vector3d::UnitZ(), -1};
  const Plane wall{-Eigen::Vector3d::UnitZ(), -3};
  auto seen = points_on(wall, *camera_, {330, 0, 300, 479}, 200, &random_);
  for (const PointInView& p : points_on(desk, *camera_, {0, 0, 290, 479}, 200, &random_)) seen.push_back(p);
  const auto place = pick_place({305, 240}, *camera_, seen);
  ASSERT_TRUE(place.has_value());
  EXPECT_NEAR(place->z(), 1, 1e-6);
}

TEST_F(LabelViewTest, AStrayPointIsNotMeant) {
  const Plane desk{-Eigen::Vector3d::UnitZ(), -2};
  for (const double away : {4.0, 18.0}) {  // pointed at, and the nearest around
    auto seen = points_on(desk, *camera_, everywhere_, 300, &random_);
    std::erase_if(seen,
                  [](const PointInView& p) { return (p.pixel - Eigen::Vector2d(320, 240)).norm() < 25; });
    const Eigen::Vector2d stray(320 + away, 240);
    seen.push_back({stray, 5 * camera_->unproject(stray)});
    const auto place = pick_place({320, 240}, *camera_, seen);
    ASSERT_TRUE(place.has_value());
    EXPECT_NEAR(place->z(), 2, 1e-6);
  }
}

TEST_F(LabelViewTest, WhereNoPointIsNearThereIsNoPlace) {
  EXPECT_FALSE(pick_place({320, 240}, *camera_, {}));
  const std::vector<PointInView> far{
      {{10, 10}, {-1, -1, 1}}, {{14, 10}, {-1, -1, 1}}, {{10, 14}, {-1, -1, 1}}};
  EXPECT_FALSE(pick_place({320, 240}, *camera_, far));
  const std::vector<PointInView> too_few{{{290, 240}, {0, 0, 1}}, {{350, 240}, {0, 0, 1}}};
  EXPECT_FALSE(pick_place({320, 240}, *camera_, too_few));
}

TEST_F(LabelViewTest, PointsOnALineGiveTheirDistance) {
  std::vector<PointInView> line;
  for (int i = 0; i < 8; ++i) {
    const Eigen::Vector2d pixel(280 + 10 * i, 200);
    line.push_back({pixel, 2 * camera_->unproject(pixel)});
  }
  const auto place = pick_place({320, 240}, *camera_, line);
  ASSERT_TRUE(place.has_value());
  EXPECT_NEAR(place->norm(), 2, 1e-9);
}

TEST_F(LabelViewTest, BoxesStayInTheAreaAndAreFoundWhereTheyAre) {
  std::vector<LabelInView> shown;
  for (const Eigen::Vector2d& pixel :
       {Eigen::Vector2d(0, 0), Eigen::Vector2d(639, 0), Eigen::Vector2d(0, 479), Eigen::Vector2d(639, 479)}) {
    LabelInView label{label_at(shown.size() + 1, {}), pixel, 1, false};
    label.label.text = std::string(200, 'w');
    shown.push_back(label);
  }
  for (const int scale : {1, 2}) {
    const cv::Size area(640 * scale, 480 * scale);
    for (const LabelBox& box : lay_out_labels(shown, area, scale, painter_)) {
      EXPECT_EQ(box.box & cv::Rect({0, 0}, area), box.box);
      EXPECT_EQ(find_label({box}, box.box.tl())->shown.label.id, box.shown.label.id);
      EXPECT_NE(find_label({box}, box.anchor), nullptr);
      EXPECT_EQ(find_label({box}, {320 * scale, 240 * scale}), nullptr);
    }
  }
}

/// Forty letters are shown, whatever bytes they have.
TEST_F(LabelViewTest, ALongTextIsCutBetweenLetters) {
  LabelInView shown{label_at(1, Eigen::Vector3d::Zero()), {320, 240}, 1, false};
  const auto text_of = [&](const std::string& letter) {
    shown.label.text.clear();
    for (int i = 0; i < 41; ++i) shown.label.text += letter;
    return lay_out_labels({shown}, {640, 480}, 1, painter_).front().text;
  };
  for (const std::string letter : {"x", "ü", "工", "u\u0308"}) {
    std::string expected;
    for (int i = 0; i < 37; ++i) expected += letter;
    EXPECT_EQ(text_of(letter), expected + "...");
  }
}

TEST_F(LabelViewTest, SeenLabelsAreBrightAndHiddenOnesFaint) {
  LabelInView shown{label_at(1, Eigen::Vector3d::Zero()), {320, 240}, 1, false};
  const cv::Mat grey(480, 640, CV_8UC3, cv::Scalar(90, 90, 90));
  const auto colored = [&](bool hidden) {
    shown.hidden = hidden;
    cv::Mat image = grey.clone();
    paint_labels(lay_out_labels({shown}, image.size(), 1, painter_), {}, painter_, &image);
    EXPECT_GT(cv::norm(image, grey, cv::NORM_L1), 0);
    cv::Mat channels[3];
    cv::split(image, channels);
    return cv::countNonZero(channels[0] != channels[2]);
  };
  EXPECT_GT(colored(false), 500);
  EXPECT_EQ(colored(true), 0);
}

}  // namespace
}  // namespace cairn
