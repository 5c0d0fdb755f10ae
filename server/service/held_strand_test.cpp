// SPDX-License-Identifier: Apache-2.0
#include "server/service/held_strand.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "server/service/by_hand.h"

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

class HeldStrandTest : public ::testing::Test {
 protected:
  void run() {
    while (!tasks_.empty()) tasks_.run_one();
  }
  Task note(const std::string& word) {
    return [this, word] { done_.push_back(word); };
  }

  TasksByHand tasks_;
  std::vector<std::string> done_;
  std::shared_ptr<HeldStrand> strand_ = std::make_shared<HeldStrand>(std::make_unique<ByHand>(&tasks_));
};

TEST_F(HeldStrandTest, WhoHoldsItWorksInItAndTheOthersWait) {
  HeldStrand::Hold hold;
  strand_->submit(note("export"));
  strand_->hold([&](HeldStrand::Hold given) {
    note("held")();
    hold = std::move(given);
  });
  strand_->submit(note("import"));
  EXPECT_THAT(done_, IsEmpty());
  run();
  EXPECT_THAT(done_, ElementsAre("export", "held"));
  strand_->submit_within(hold, note("roll-back"));
  strand_->submit(note("backup"));
  run();
  EXPECT_THAT(done_, ElementsAre("export", "held", "roll-back"));
  hold.reset();
  run();
  EXPECT_THAT(done_, ElementsAre("export", "held", "roll-back", "import", "backup"));
}

TEST_F(HeldStrandTest, ATaskThatThrowsOrIsDroppedHoldsUpNobody) {
  strand_->submit([] { throw std::runtime_error("memory"); });
  strand_->hold([](const HeldStrand::Hold&) {});
  strand_->submit(note("next"));
  EXPECT_THROW(run(), std::runtime_error);
  run();
  EXPECT_THAT(done_, ElementsAre("next"));
  HeldStrand::Hold hold;
  strand_->hold([&](HeldStrand::Hold given) { hold = std::move(given); });
  strand_->submit(note("never"));
  run();
  strand_->stop();
  hold.reset();
  strand_->submit(note("never"));
  run();
  EXPECT_THAT(done_, ElementsAre("next"));
}

}  // namespace
}  // namespace cairn
