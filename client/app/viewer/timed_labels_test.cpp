// SPDX-License-Identifier: Apache-2.0
#include "client/app/viewer/timed_labels.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "client/app/viewer/test_map.h"
#include "common/io/test_directory.h"

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::keyframe_pose;
using testing::kKeyframe;
using testing::kMap;
using ::testing::SizeIs;
using testing::test_camera;
using testing::TestMap;

Timestamp at(double seconds) {
  return Timestamp::from_seconds(seconds);
}

class ReadTimedLabels : public ::testing::Test {
 protected:
  Result<std::vector<TimedLabel>> read(const std::string& content) {
    std::ofstream(path_) << content;
    return read_timed_labels(path_, {640, 480});
  }
  TestDirectory directory_;
  std::filesystem::path path_ = directory_.path() / "timed_labels_test.txt";
};

TEST_F(ReadTimedLabels, RowsOfAnyOrderAndTextsOfSeveralWords) {
  const auto labels = read(
      "\xef\xbb\xbf# comment\ntimestamp x y text\n2.5 639 0 the  small, vice \n\n1.033333333 0 479 "
      "Küche 工作台\r\n");
  ASSERT_TRUE(labels) << labels.error().message;
  ASSERT_EQ(labels->size(), 2U);
  EXPECT_EQ((*labels)[0].time, Timestamp{1'033'333'333});
  EXPECT_EQ((*labels)[0].pixel, cv::Point(0, 479));
  EXPECT_EQ((*labels)[0].text, "Küche 工作台");
  EXPECT_EQ((*labels)[1].text, "the  small, vice");
}

TEST_F(ReadTimedLabels, WhatNobodyCouldPointAtOrTypeIsNamed) {
  const std::string long_text(300, 'x');
  for (const std::string& row :
       {std::string("1 2 3"), std::string("now 2 3 text"), std::string("1 640 3 text"),
        std::string("1 2 -1 text"), std::string("1 2 nan text"), std::string("1 2 3 gr\xfcn"),
        std::string("1 2 3 a\u202eb"), std::string("1 2 3 \u3000"), "1 2 3 " + long_text}) {
    const auto labels = read("# first\n" + row + "\n");
    ASSERT_FALSE(labels) << row;
    EXPECT_EQ(labels.error().code, ErrorCode::kDamaged);
    EXPECT_THAT(labels.error().message, HasSubstr("timed_labels_test.txt:2: "));
  }
  EXPECT_EQ(read_timed_labels("/nowhere/labels.txt", {640, 480}).error().code, ErrorCode::kNotFound);
}

class LabelPlacerTest : public ::testing::Test {
 protected:
  LabelPlacer placer(const std::vector<TimedLabel>& labels) {
    ViewerLink link{[](MapId) { return LabelListPtr(); },
                    [this](wire::ClientRequest request) { requests_.push_back(std::move(request)); },
                    [this] { return std::exchange(replies_, {}); }};
    auto log =
        std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(said_));
    return {labels, camera_, std::move(link), std::move(log)};
  }
  void frame(LabelPlacer* placer, double seconds, FrameState state = FrameState::kTracking) {
    FrameResult result;
    result.map = kMap;
    result.camera_from_map = camera_from_map_;
    result.points = map_.tracked;
    const Frame frame{0, at(seconds), std::make_shared<const GrayImage>(640, 480)};
    const MapSnapshotPtr snapshot = map_.snapshot;
    placer->on_frame(
        {number_++, frame, result, state, snapshot, labels_, SessionStatus(), StageTimes(), {}, {}, nullptr});
  }
  [[nodiscard]] std::vector<std::string> texts() const {
    std::vector<std::string> texts;
    for (const auto& request : requests_) texts.push_back(request.text);
    return texts;
  }

  CameraPtr camera_ = test_camera();
  SE3 camera_from_map_ = SE3::exp((Vector6d() << -0.3, 0.1, 0.2, 0.1, -0.2, 0.3).finished());
  TestMap map_{*camera_, camera_from_map_};
  const cv::Point on_a_point_{200 + 4 * 32, 120 + 3 * 32};
  LabelListPtr labels_;
  std::vector<wire::ClientRequest> requests_;
  std::vector<RequestReply> replies_;
  std::ostringstream said_;
  size_t number_ = 0;
};

TEST_F(LabelPlacerTest, AsksForTheLabelAtThePixelOfTheFrameOfItsTime) {
  LabelPlacer placer = this->placer({{at(1), on_a_point_, "The vice, 2"}});
  frame(&placer, 0.9);
  EXPECT_THAT(requests_, IsEmpty());
  frame(&placer, 1);
  frame(&placer, 1.1);
  ASSERT_THAT(requests_, SizeIs(1)) << "once";
  EXPECT_EQ(requests_[0].action, wire::RequestAction::kAddLabel);
  EXPECT_EQ(requests_[0].map, kMap);
  EXPECT_EQ(requests_[0].text, "The vice, 2");
  EXPECT_EQ(requests_[0].reference, kKeyframe);
  const Eigen::Vector3d place = (keyframe_pose().inverse() * requests_[0].reference_from_label).translation();
  const auto pixel = camera_->project(camera_from_map_ * place);
  ASSERT_TRUE(pixel);
  EXPECT_LT((*pixel - Eigen::Vector2d(on_a_point_.x, on_a_point_.y)).norm(), 1e-2);
}

TEST_F(LabelPlacerTest, SaysWhatTheServerMadeOfEach) {
  LabelPlacer placer = this->placer({{at(1), on_a_point_, "vice"}, {at(2), on_a_point_, "lamp"}});
  frame(&placer, 1);
  frame(&placer, 2);
  EXPECT_THAT(texts(), ElementsAre("vice", "lamp"));
  replies_ = {{1, true, "", kMap, {1}}, {2, false, "frozen", kMap, {}}};
  placer.finish();
  EXPECT_THAT(said_.str(), HasSubstr("label 'vice' placed"));
  EXPECT_THAT(said_.str(), HasSubstr("label 'lamp' not placed: refused: frozen"));
  EXPECT_THAT(said_.str(), HasSubstr("labels placed: 1 of 2"));
}

TEST_F(LabelPlacerTest, SaysWhyOneCouldNotBePlaced) {
  Label there;
  there.id = {9};
  there.text = "drill";
  there.author = "anna";
  there.map_from_label =
      camera_from_map_.inverse() *
      SE3(Eigen::Quaterniond::Identity(), 2 * camera_->unproject({on_a_point_.x + 0.0, on_a_point_.y + 0.0}));
  LabelPlacer placer = this->placer({{at(1), on_a_point_, "lost"},
                                     {at(2), {5, 5}, "no points"},
                                     {at(3), on_a_point_, "dropped"},
                                     {at(4), on_a_point_, "second"},
                                     {at(5), on_a_point_, "unanswered"},
                                     {at(9), on_a_point_, "too late"}});
  frame(&placer, 1, FrameState::kLost);
  frame(&placer, 2);
  frame(&placer, 3.033);
  labels_ = std::make_shared<const std::vector<Label>>(std::vector{there});
  frame(&placer, 4);
  EXPECT_THAT(requests_, IsEmpty());
  labels_ = nullptr;
  frame(&placer, 5);
  placer.finish();
  const std::string said = said_.str();
  EXPECT_THAT(said, HasSubstr("frame 0: label 'lost' not placed: no map here"));
  EXPECT_THAT(said, HasSubstr("label 'no points' not placed: the map has no points there"));
  EXPECT_THAT(said, HasSubstr("label 'dropped' not placed: the frame of its time was dropped"));
  EXPECT_THAT(said, HasSubstr("label 'second' not placed: there is a label: drill, by anna"));
  EXPECT_THAT(said, HasSubstr("label 'unanswered' may not be placed: the server has not answered"));
  EXPECT_THAT(said, HasSubstr("label 'too late' not placed: its time did not come"));
  EXPECT_THAT(said, HasSubstr("labels placed: 0 of 6"));
}

}  // namespace
}  // namespace cairn
