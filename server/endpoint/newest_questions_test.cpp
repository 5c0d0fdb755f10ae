// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/newest_questions.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

wire::RelocQuery question(uint64_t session, uint64_t seq) {
  wire::RelocQuery made;
  made.command = {SessionId{session}, seq};
  return made;
}

std::vector<std::string> handed_over(NewestQuestions* questions) {
  std::vector<std::string> all;
  questions->hand_over([&all](const Principal& who, const wire::RelocQuery& asked) {
    all.push_back(who.name + " " + std::to_string(asked.command.session.value) + " " +
                  std::to_string(asked.command.seq));
  });
  return all;
}

TEST(NewestQuestions, OfEachProcessTheNewestCountsAndNoneIsInTheWayOfAnother) {
  const Principal anna = client_principal("anna");
  const Principal bob = client_principal("bob");
  NewestQuestions questions;
  questions.put(anna, question(1, 6));
  questions.put(bob, question(1, 3));
  questions.put(anna, question(1, 7));
  questions.put(anna, question(66, 900));  // an intruder
  EXPECT_THAT(handed_over(&questions), ElementsAre("anna 1 7", "anna 66 900", "bob 1 3"));
  EXPECT_THAT(handed_over(&questions), IsEmpty());
}

}  // namespace
}  // namespace cairn
