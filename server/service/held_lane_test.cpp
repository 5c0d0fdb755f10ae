// SPDX-License-Identifier: Apache-2.0
#include "server/service/held_lane.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "server/service/by_hand.h"

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

class HeldLaneTest : public ::testing::Test {
 protected:
  void run() {
    while (!tasks_.empty()) tasks_.run_one();
  }
  Task note(const std::string& word) {
    return [this, word] { done_.push_back(word); };
  }

  TasksByHand tasks_;
  std::vector<std::string> done_;
  std::shared_ptr<HeldLane> lane_ = std::make_shared<HeldLane>(std::make_unique<ByHand>(&tasks_));
};

TEST_F(HeldLaneTest, WhoHoldsItWorksInItAndTheOthersWait) {
  HeldLane::Hold hold;
  lane_->submit(note("export"));
  lane_->hold([&](HeldLane::Hold given) {
    note("held")();
    hold = std::move(given);
  });
  lane_->submit(note("import"));
  EXPECT_THAT(done_, IsEmpty());
  run();
  EXPECT_THAT(done_, ElementsAre("export", "held"));
  lane_->submit_within(hold, note("roll-back"));
  lane_->submit(note("backup"));
  run();
  EXPECT_THAT(done_, ElementsAre("export", "held", "roll-back"));
  hold.reset();
  run();
  EXPECT_THAT(done_, ElementsAre("export", "held", "roll-back", "import", "backup"));
}

TEST_F(HeldLaneTest, ATaskThatThrowsOrIsDroppedHoldsUpNobody) {
  lane_->submit([] { throw std::runtime_error("memory"); });
  lane_->hold([](const HeldLane::Hold&) {});
  lane_->submit(note("next"));
  EXPECT_THROW(run(), std::runtime_error);
  run();
  EXPECT_THAT(done_, ElementsAre("next"));
  HeldLane::Hold hold;
  lane_->hold([&](HeldLane::Hold given) { hold = std::move(given); });
  lane_->submit(note("never"));
  run();
  lane_->stop();
  hold.reset();
  lane_->submit(note("never"));
  run();
  EXPECT_THAT(done_, ElementsAre("next"));
}

}  // namespace
}  // namespace cairn
