// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/newest_queries.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

wire::RelocQuery query(uint64_t session, uint64_t seq) {
  wire::RelocQuery made;
  made.command = {SessionId{session}, seq};
  return made;
}

std::vector<std::string> handed_over(NewestQueries* queries) {
  std::vector<std::string> all;
  queries->hand_over([&all](const Principal& who, const wire::RelocQuery& asked) {
    all.push_back(who.name + " " + std::to_string(asked.command.session.value) + " " +
                  std::to_string(asked.command.seq));
  });
  return all;
}

TEST(NewestQueries, OfEachProcessTheNewestCountsAndNoneIsInTheWayOfAnother) {
  const Principal anna = client_principal("anna");
  const Principal bob = client_principal("bob");
  NewestQueries queries;
  queries.put(anna, query(1, 6));
  queries.put(bob, query(1, 3));
  queries.put(anna, query(1, 7));
  queries.put(anna, query(66, 900));  // an intruder
  EXPECT_THAT(handed_over(&queries), ElementsAre("anna 1 7", "anna 66 900", "bob 1 3"));
  EXPECT_THAT(handed_over(&queries), IsEmpty());
}

}  // namespace
}  // namespace cairn
