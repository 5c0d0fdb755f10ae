// SPDX-License-Identifier: Apache-2.0
#include "tests/world/labels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>

#include "common/image/corners.h"
#include "common/io/test_directory.h"

namespace cairn {
namespace {

SimulatorOptions map_options(uint64_t seed, Carrier carrier = Carrier::kHand) {
  SimulatorOptions options;
  options.seed = seed;
  options.carrier = carrier;
  options.session = Session::kMap;
  return options;
}

int frame_at(Timestamp time) {
  return static_cast<int>(std::lround(time.seconds() * kSimulatorFrameRate));
}

class LabelFiles : public ::testing::Test {
 protected:
  void write(const char* name, const std::string& content) const { std::ofstream(folder_ / name) << content; }
  TestDirectory directory_;
  const std::filesystem::path& folder_ = directory_.path();
};

TEST(SimulatorThings, APointOfAPlaceShowsWhereTheCameraProjectsItInEveryFrame) {
  const auto simulator = Simulator::make("building", map_options(1));
  ASSERT_TRUE(simulator);
  int looked_at = 0;
  for (const Phase& phase : simulator->phases()) {
    if (phase.kind != PhaseKind::kMap) continue;
    const int frame = static_cast<int>((0.5 * phase.begin + 0.5 * phase.end) * kSimulatorFrameRate);
    const auto thing = simulator->thing_at(frame, {320, 240});
    if (!thing) continue;  // between the place's things
    ++looked_at;
    const SimView later = simulator->view(frame + 3);
    const auto shown = std::ranges::find(later.places, thing->place, &SimView::PlaceShare::place);
    ASSERT_NE(shown, later.places.end());
    const SE3 camera_from_map = simulator->map_from_camera(simulator->time(frame + 3).seconds()).inverse();
    const auto pixel =
        simulator->camera().project(camera_from_map * (shown->map_from_place * thing->in_place));
    ASSERT_TRUE(pixel);
    const auto again = simulator->thing_at(frame + 3, *pixel);
    ASSERT_TRUE(again);
    EXPECT_EQ(again->place, thing->place);
    EXPECT_LT((again->in_place - thing->in_place).norm(), 1e-4 * thing->depth);
  }
  EXPECT_GE(looked_at, 3);
}

TEST(SimulatorThings, InTheDarkThereIsNothing) {
  SimulatorOptions options = map_options(1);
  options.walks = Walks::kDark;
  const auto simulator = Simulator::make("building", options);
  ASSERT_TRUE(simulator);
  const auto phases = simulator->phases();
  const auto walk = std::ranges::find(phases, PhaseKind::kWalk, &Phase::kind);
  ASSERT_NE(walk, phases.end());
  EXPECT_FALSE(simulator->thing_at(static_cast<int>(walk->begin * kSimulatorFrameRate) + 5, {320, 240}));
}

TEST(LabelTargets, EachPlaceMappedHasOneOnACornerOfItsOwnWhenItIsMapped) {
  for (const Carrier carrier : {Carrier::kHand, Carrier::kShoulder}) {
    auto simulator = Simulator::make("building", map_options(3, carrier));
    ASSERT_TRUE(simulator);
    const auto targets = choose_label_targets(&*simulator);
    EXPECT_EQ(targets.size(), 5U);
    for (const auto& [thing, time, pixel] : targets) {
      const int frame = frame_at(time);
      EXPECT_EQ(simulator->time(frame), time);
      const auto shown = simulator->thing_at(frame, pixel.cast<double>());
      ASSERT_TRUE(shown);
      EXPECT_EQ(simulator->places()[static_cast<size_t>(shown->place)].name, thing.place);
      EXPECT_LT((shown->in_place - thing.point).norm(), 1e-9);
      for (const int dx : {-12, 12}) {
        const auto beside = simulator->thing_at(frame, pixel.cast<double>() + Eigen::Vector2d(dx, 0));
        ASSERT_TRUE(beside);
        EXPECT_LT(std::abs(beside->depth - shown->depth), 0.05 * shown->depth) << thing.place;
      }
      EXPECT_GT(fast10_score(simulator->frame(frame).image.view(), pixel.x(), pixel.y()), 0);
      const bool in_its_phase =
          std::ranges::any_of(simulator->phases(), [&, time = time](const Phase& phase) {
            return phase.kind == PhaseKind::kMap && phase.place == shown->place &&
                   time.seconds() >= phase.begin + 0.7 * (phase.end - phase.begin) &&
                   time.seconds() < phase.end;
          });
      EXPECT_TRUE(in_its_phase) << thing.place;
    }
  }
}

TEST(LabelTargets, AWalkThatOnlyVisitsHasNone) {
  SimulatorOptions options = map_options(1);
  options.session = Session::kVisit;
  auto simulator = Simulator::make("building", options);
  ASSERT_TRUE(simulator);
  EXPECT_TRUE(choose_label_targets(&*simulator).empty());
}

TEST_F(LabelFiles, TruthReadsAsItWasWritten) {
  const std::vector<LabelTarget> targets = {
      {{"desk-1", {0.25, -1.5, 0.125}}, Timestamp{1'033'333'333}, {320, 241}},
      {{"desk-2", {0, 2, -3}}, Timestamp{7}, {40, 50}}};
  ASSERT_TRUE(write_label_targets(folder_, targets));
  const auto read = read_label_truth(folder_);
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->size(), 2U);
  EXPECT_EQ((*read)[1].place, "desk-2");
  EXPECT_LT(((*read)[0].point - targets[0].thing.point).norm(), 1e-9);
  std::ifstream labels(folder_ / "labels.txt");
  std::string row;
  std::getline(labels, row);
  std::getline(labels, row);
  EXPECT_EQ(row, "1.033333333 320 241 desk-1");
}

TEST_F(LabelFiles, ADamagedOneIsNamed) {
  write("label_truth.txt", "# place x y z\ndesk-1 0 0\n");
  const auto truth = read_label_truth(folder_);
  ASSERT_FALSE(truth);
  EXPECT_EQ(truth.error().code, ErrorCode::kDamaged);
  EXPECT_NE(truth.error().message.find("label_truth.txt:2"), std::string::npos) << truth.error().message;
  for (const char* content : {"no JSON", "[{\"map\": \"m\"}]", "[{\"map\": \"m\", \"text\": 5}]",
                              "[{\"map\": \"m\", \"text\": \"t\", \"position\": [0, 1]}]"}) {
    write("labels.json", content);
    const auto placed = read_placed_labels(folder_ / "labels.json");
    ASSERT_FALSE(placed) << content;
    EXPECT_EQ(placed.error().code, ErrorCode::kDamaged);
  }
}

TEST_F(LabelFiles, PlacedLabelsAreThoseOfCairnctl) {
  write("labels.json",
        R"([{"map": "map-1", "id": 1, "kind": "text", "text": "desk-1", "position": [1, 2.5, -3]}])");
  const auto placed = read_placed_labels(folder_ / "labels.json");
  ASSERT_TRUE(placed) << placed.error().message;
  ASSERT_EQ(placed->size(), 1U);
  EXPECT_EQ((*placed)[0].map, "map-1");
  EXPECT_EQ((*placed)[0].text, "desk-1");
  EXPECT_EQ((*placed)[0].position, Eigen::Vector3d(1, 2.5, -3));
}

}  // namespace
}  // namespace cairn
