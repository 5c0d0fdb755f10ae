// SPDX-License-Identifier: Apache-2.0
#include "client/app/viewer/controls.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client/app/viewer/painter.h"
#include "client/app/viewer/test_map.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::kDepth;
using testing::kEpoch;
using testing::keyframe_pose;
using testing::kKeyframe;
using testing::kMap;
using testing::test_camera;
using testing::TestMap;

constexpr int kEscape = 0x1b;

class ControlsTest : public ::testing::Test {
 protected:
  void SetUp() override { controls_.show(frame(1)); }

  [[nodiscard]] OverlayFrame frame(size_t number) const {
    OverlayFrame made;
    made.image = std::make_shared<const GrayImage>(640, 480);
    made.number = number;
    made.state = FrameState::kTracking;
    made.camera_from_map = camera_from_map_;
    made.map = kMap;
    made.snapshot = map_.snapshot;
    made.points = map_.tracked;
    made.labels = labels_;
    return made;
  }
  /// A label in the map at a pixel.
  void put_label(uint64_t id, const std::string& text, const Eigen::Vector2d& pixel) {
    Label label;
    label.id = {id};
    label.text = text;
    label.author = "anna";
    const Eigen::Vector3d ray = camera_->unproject(pixel);
    label.map_from_label = camera_from_map_.inverse() * SE3(Eigen::Quaterniond::Identity(), kDepth * ray);
    labels_ = std::make_shared<const std::vector<Label>>(std::vector{label});
    controls_.show(frame(2));
  }
  void touch(int x, int y) { controls_.touch({x, y}, kImage, 1, now_); }
  void press(const std::string& keys) {
    for (const char key : keys) controls_.press(key, now_);
  }

  const cv::Size kImage{640, 524};
  CameraPtr camera_ = test_camera();
  SE3 camera_from_map_ = SE3::exp((Vector6d() << -0.3, 0.1, 0.2, 0.1, -0.2, 0.3).finished());
  TestMap map_{*camera_, camera_from_map_};
  LabelListPtr labels_;
  ViewerControls controls_{camera_, ViewerOptions{}};
  MonotonicTime now_{std::chrono::hours(1)};
};

TEST_F(ControlsTest, ATouchAndATextAskForALabelAtThatPlace) {
  touch(200 + 4 * 32 + 3, 120 + 3 * 32);
  ASSERT_NE(controls_.entry(), nullptr);
  EXPECT_THAT(controls_.take_wishes().requests, IsEmpty()) << "it has no text yet";
  press("vice\r");
  EXPECT_EQ(controls_.entry(), nullptr);
  const ViewerWishes wishes = controls_.take_wishes();
  ASSERT_EQ(wishes.requests.size(), 1U);
  const wire::ClientRequest& request = wishes.requests[0];
  EXPECT_EQ(request.action, wire::RequestAction::kAddLabel);
  EXPECT_EQ(request.map, kMap);
  EXPECT_EQ(request.text, "vice");
  EXPECT_EQ(request.epoch, kEpoch);
  EXPECT_EQ(request.reference, kKeyframe);
  const SE3 map_from_label = keyframe_pose().inverse() * request.reference_from_label;
  const auto pixel = camera_->project(camera_from_map_ * map_from_label.translation());
  ASSERT_TRUE(pixel.has_value());
  EXPECT_LT((*pixel - Eigen::Vector2d(200 + 4 * 32, 120 + 3 * 32)).norm(), 1e-2) << "on the point";
  EXPECT_LT((camera_from_map_ * map_from_label).rotation().angularDistance(Eigen::Quaterniond::Identity()),
            1e-9)
      << "upright for who pointed";
  EXPECT_THAT(controls_.take_wishes().requests, IsEmpty()) << "once";
}

TEST_F(ControlsTest, TheKeysOfARigAreThereWhereThereIsOne) {
  press(" s");
  EXPECT_FALSE(controls_.take_wishes().rig);
  ViewerOptions options;
  options.has_rig = true;
  ViewerControls of_rig(camera_, options);
  for (const auto& [key, wish] : {std::pair{' ', RigKey::kStop},
                                  {'c', RigKey::kClear},
                                  {'a', RigKey::kNeutral},
                                  {'w', RigKey::kFollow},
                                  {'l', RigKey::kLock},
                                  {'t', RigKey::kFixate},
                                  {'s', RigKey::kSearch}}) {
    of_rig.press(key, now_);
    EXPECT_EQ(of_rig.take_wishes().rig, wish) << key;
  }
  EXPECT_FALSE(of_rig.take_wishes().rig);
}

TEST_F(ControlsTest, OneKeyStopsTheRigWhateverIsTyped) {
  ViewerOptions options;
  options.has_rig = true;
  ViewerControls of_rig(camera_, options);
  of_rig.show(frame(1));
  of_rig.touch({200 + 4 * 32, 120 + 3 * 32}, kImage, 1, now_);
  ASSERT_NE(of_rig.entry(), nullptr);
  of_rig.press(' ', now_);
  EXPECT_FALSE(of_rig.take_wishes().rig) << "a letter";
  of_rig.press(0xffc9, now_);
  EXPECT_EQ(of_rig.take_wishes().rig, RigKey::kStop);
  ASSERT_NE(of_rig.entry(), nullptr) << "what was typed is not lost";
  EXPECT_EQ(of_rig.entry()->text(), " ");
}

TEST_F(ControlsTest, KeysAreLettersWhileATextIsTyped) {
  touch(328, 216);
  press("qnf");
  ViewerWishes wishes = controls_.take_wishes();
  EXPECT_FALSE(wishes.quit || wishes.new_map || controls_.frozen());
  ASSERT_NE(controls_.entry(), nullptr);
  EXPECT_EQ(controls_.entry()->text(), "qnf");
  controls_.press(kEscape, now_);
  EXPECT_EQ(controls_.entry(), nullptr);
  EXPECT_THAT(controls_.take_wishes().requests, IsEmpty());
  press("qn");
  wishes = controls_.take_wishes();
  EXPECT_TRUE(wishes.quit && wishes.new_map);
}

TEST_F(ControlsTest, TheDrawnKeyboardTakesTouchesWhileATextIsTyped) {
  touch(328, 216);
  for (const char* cap : {"v", "i", "OK"}) {
    for (const DrawnKey& key : lay_out_keyboard(kImage, false)) {
      if (key.cap == cap) touch(key.place.x + 5, key.place.y + 5);
    }
  }
  const auto requests = controls_.take_wishes().requests;
  ASSERT_EQ(requests.size(), 1U);
  EXPECT_EQ(requests[0].text, "vi");
}

TEST_F(ControlsTest, ALabelIsSelectedThenChangedOrDeleted) {
  put_label(5, "vise", {300, 200});
  press("d");
  EXPECT_THAT(controls_.message(now_), HasSubstr("click a label"));
  EXPECT_THAT(controls_.take_wishes().requests, IsEmpty()) << "none was selected";
  touch(300, 200);
  EXPECT_EQ(controls_.selected(), LabelId{5});
  EXPECT_EQ(controls_.entry(), nullptr) << "no label is put on a label";
  EXPECT_THAT(controls_.message(now_), HasSubstr("anna"));
  press("e");
  ASSERT_NE(controls_.entry(), nullptr);
  EXPECT_EQ(controls_.entry()->text(), "vise");
  press("\b\bce\r");
  auto requests = controls_.take_wishes().requests;
  ASSERT_EQ(requests.size(), 1U);
  EXPECT_EQ(requests[0].action, wire::RequestAction::kRenameLabel);
  EXPECT_EQ(requests[0].label, LabelId{5});
  EXPECT_EQ(requests[0].text, "vice");
  press("d");
  requests = controls_.take_wishes().requests;
  ASSERT_EQ(requests.size(), 1U);
  EXPECT_EQ(requests[0].action, wire::RequestAction::kRemoveLabel);
  EXPECT_EQ(requests[0].map, kMap);
  EXPECT_EQ(requests[0].label, LabelId{5});
  EXPECT_FALSE(controls_.selected());
}

TEST_F(ControlsTest, AFrozenViewKeepsItsFrameAndPlacesLabelsInIt) {
  press("f");
  controls_.show(frame(9));
  EXPECT_EQ(controls_.frame()->number, 1U);
  touch(328, 216);
  EXPECT_NE(controls_.entry(), nullptr);
  controls_.press(kEscape, now_);
  press("f");
  EXPECT_EQ(controls_.frame()->number, 9U) << "it goes on with the newest";
  controls_.show(frame(10));
  EXPECT_EQ(controls_.frame()->number, 10U);
}

TEST_F(ControlsTest, WithoutAPoseThereIsNoPlaceAndAReaderLeavesLabelsAlone) {
  OverlayFrame lost = frame(3);
  lost.camera_from_map.reset();
  controls_.show(lost);
  touch(328, 216);
  EXPECT_EQ(controls_.entry(), nullptr);
  EXPECT_THAT(controls_.message(now_), HasSubstr("no map"));

  controls_ = ViewerControls(camera_, ViewerOptions{false, false});
  put_label(5, "vice", {300, 200});
  touch(360, 300);
  EXPECT_EQ(controls_.entry(), nullptr);
  touch(300, 200);
  EXPECT_EQ(controls_.selected(), LabelId{5}) << "it may read who wrote it";
  press("de");
  EXPECT_EQ(controls_.entry(), nullptr);
  EXPECT_THAT(controls_.take_wishes().requests, IsEmpty());
}

TEST_F(ControlsTest, TouchesBesideTheImageOrTheMapDoNothing) {
  touch(320, 500);
  EXPECT_EQ(controls_.entry(), nullptr) << "the status lines";
  touch(5, 5);
  EXPECT_EQ(controls_.entry(), nullptr);
  EXPECT_THAT(controls_.message(now_), HasSubstr("no points there"));
}

TEST_F(ControlsTest, WordsGoAfterAWhileAndRefusalsSayWhy) {
  controls_.replied({1, false, "the map is full", kMap, {}}, now_);
  EXPECT_EQ(controls_.message(now_), "refused: the map is full");
  EXPECT_EQ(controls_.message(now_ + std::chrono::minutes(1)), "");
}

TEST_F(ControlsTest, EveryKeyOfTheHelpDoesSomethingAndOthersPointToIt) {
  for (const std::string& line : ViewerControls::help()) {
    if (line.find("   ") != 1) continue;
    ViewerControls controls(camera_, ViewerOptions{});
    controls.press(line[0], now_);
    EXPECT_THAT(controls.message(now_), ::testing::Not(HasSubstr("h shows"))) << line;
  }
  press("x");
  EXPECT_THAT(controls_.message(now_), HasSubstr("h shows the keys"));
}

TEST_F(ControlsTest, AKeyGoesThroughTheWearersCamerasAndBack) {
  press("o");
  EXPECT_THAT(controls_.message(now_), HasSubstr("--wearer"));
  ViewerOptions options;
  options.wearer = "ada";
  controls_ = ViewerControls(camera_, options);
  controls_.show(frame(1));
  press("o");
  EXPECT_THAT(controls_.message(now_), HasSubstr("no other camera of wearer ada"));
  EXPECT_EQ(controls_.wanted(), "");
  controls_.show_others({"head", "shoulder"}, {});
  for (const char* wanted : {"head", "shoulder", "", "head"}) {
    press("o");
    EXPECT_EQ(controls_.wanted(), wanted);
    EXPECT_EQ(controls_.other().camera, wanted) << "at once";
  }
  OtherView view;
  view.camera = "shoulder";
  controls_.show_others({"head", "shoulder"}, view);
  EXPECT_EQ(controls_.other().camera, "head") << "an image of the one before comes late";
  touch(200 + 4 * 32, 120 + 3 * 32);
  EXPECT_EQ(controls_.entry(), nullptr) << "that pixel is another camera's";
  EXPECT_THAT(controls_.message(now_), HasSubstr("head"));
  controls_.show_others({"shoulder"}, {});  // the one that is shown has gone
  press("o");
  EXPECT_EQ(controls_.wanted(), "shoulder");
  press("o");
  touch(200 + 4 * 32, 120 + 3 * 32);
  EXPECT_NE(controls_.entry(), nullptr);
}

TEST_F(ControlsTest, AFrozenViewKeepsTheOtherCamerasImageToo) {
  controls_.show_others({"shoulder"}, {});
  press("of");
  OtherView view;
  view.camera = "shoulder";
  view.note = "new";
  controls_.show_others({"shoulder"}, view);
  EXPECT_EQ(controls_.other().note, "");
  press("f");
  controls_.show_others({"shoulder"}, view);
  EXPECT_EQ(controls_.other().note, "new");
}

TEST_F(ControlsTest, AnotherCamerasImageFillsTheAreaWithThisOneInACornerAndIsGreyWhenItIsOld) {
  const cv::Rect area(0, 0, 640, 480);
  OtherView view;
  view.camera = "shoulder";
  view.is_there = true;
  view.pixels = cv::Mat(240, 320, CV_8UC3, cv::Scalar(0, 0, 250));
  const auto painted = [&] {
    cv::Mat image(kImage, CV_8UC3, cv::Scalar(250, 0, 0));
    paint_other(view, area, TextPainter(), &image);
    return image;
  };
  const cv::Mat fresh = painted();
  EXPECT_EQ(fresh.at<cv::Vec3b>(100, 300), cv::Vec3b(0, 0, 250));
  EXPECT_EQ(fresh.at<cv::Vec3b>(440, 600), cv::Vec3b(250, 0, 0)) << "this camera's";
  EXPECT_EQ(fresh.at<cv::Vec3b>(500, 300), cv::Vec3b(250, 0, 0)) << "the status lines stay";
  view.age = std::chrono::milliseconds(1001);
  const cv::Vec3b old = painted().at<cv::Vec3b>(100, 300);
  EXPECT_TRUE(old[0] == old[1] && old[1] == old[2]) << "no colours";
  view.pixels = cv::Mat();
  EXPECT_EQ(painted().at<cv::Vec3b>(440, 600), cv::Vec3b(250, 0, 0));
}

TEST_F(ControlsTest, WhatIsShownIsDrawn) {
  cv::Mat bare(kImage, CV_8UC3, cv::Scalar(90, 90, 90));
  const auto changed_by = [&](const char* what) {
    cv::Mat image = bare.clone();
    paint_controls(controls_, now_, TextPainter(), &image);
    EXPECT_GT(cv::norm(image, bare, cv::NORM_L1), 0) << what;
    return image;
  };
  cv::Mat nothing = bare.clone();
  paint_controls(controls_, now_, TextPainter(), &nothing);
  EXPECT_EQ(cv::norm(nothing, bare, cv::NORM_L1), 0);
  press("h");
  changed_by("help");
  press("h");
  touch(328, 216);
  (void)changed_by("keyboard");
}

}  // namespace
}  // namespace cairn
