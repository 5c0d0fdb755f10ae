// SPDX-License-Identifier: Apache-2.0
#include "client/session/path_watch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cairn {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

const wire::NetworkPath kBefore{"10.77.0.1", "wlan0", "10.77.0.2"};

TEST(PathWatch, ASilentServerOnTheSamePathIsWaitedFor) {
  PathWatch watch("desk", kBefore);
  const auto advice = watch.compare(kBefore);
  EXPECT_FALSE(advice.join_anew);
  EXPECT_EQ(advice.text, "");
}

TEST(PathWatch, AnotherAddressAtEitherEndIsNamedAndJoinedAnew) {
  PathWatch watch("desk", kBefore);
  const auto of_ours = watch.compare(wire::NetworkPath{"10.77.0.1", "wlan0", "10.77.0.9"});
  EXPECT_TRUE(of_ours.join_anew);
  EXPECT_THAT(of_ours.text, AllOf(HasSubstr("wlan0 (10.77.0.9) instead of wlan0 (10.77.0.2)"),
                                  Not(HasSubstr("10.77.0.1"))));
  const auto of_server = watch.compare(wire::NetworkPath{"10.77.0.5", "wlan0", "10.77.0.2"});
  EXPECT_TRUE(of_server.join_anew);
  EXPECT_THAT(of_server.text, AllOf(HasSubstr("'desk' has the address 10.77.0.5 instead of 10.77.0.1"),
                                    Not(HasSubstr("wlan0"))));
  const auto of_both = watch.compare(wire::NetworkPath{"10.88.0.5", "eth0", "10.88.0.9"});
  EXPECT_THAT(of_both.text, AllOf(HasSubstr("10.88.0.5 instead of"), HasSubstr("eth0 (10.88.0.9)")));
}

TEST(PathWatch, OnceJoinedThereItIsNoChangeAnyMore) {
  PathWatch watch("desk", kBefore);
  const wire::NetworkPath after{"10.77.0.1", "wlan0", "10.77.0.9"};
  EXPECT_TRUE(watch.compare(after).join_anew);
  watch.joined(after);
  EXPECT_FALSE(watch.compare(after).join_anew);
  EXPECT_TRUE(watch.compare(kBefore).join_anew) << "and back";
}

TEST(PathWatch, WithoutANetworkItWaitsAndSaysWhyOnce) {
  PathWatch watch("desk", kBefore);
  const Result<wire::NetworkPath> none = fail(ErrorCode::kNoServer, "no network of this machine leads there");
  const auto first = watch.compare(none);
  EXPECT_FALSE(first.join_anew);
  EXPECT_THAT(first.text, HasSubstr("no network of this machine"));
  EXPECT_EQ(watch.compare(none).text, "");
  watch.heard();
  EXPECT_NE(watch.compare(none).text, "") << "it has gone again";
}

TEST(PathWatch, WhereNoneCouldBeMadeAnyPathIsTried) {
  PathWatch watch("desk", kBefore);
  watch.left();
  EXPECT_TRUE(watch.compare(kBefore).join_anew);
}

}  // namespace
}  // namespace cairn
