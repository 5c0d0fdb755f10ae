// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/serving.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

using Event = OwnAddress::Event;

const wire::NetworkPath kBefore{"", "wlan0", "10.77.0.1"};
const wire::NetworkPath kAfter{"", "wlan0", "10.77.0.5"};

TEST(OwnAddress, AnAddressThatIsHereIsServedOnWhateverElseComes) {
  OwnAddress address(kBefore);
  EXPECT_EQ(address.look(true, kBefore), Event::kNone);
  EXPECT_EQ(address.look(true, wire::NetworkPath{"", "eth0", "10.88.0.1"}), Event::kNone);
}

TEST(OwnAddress, OneThatHasGoneIsToldOnceAndSoIsTheNext) {
  OwnAddress address(kBefore);
  const Result<wire::NetworkPath> none = fail(ErrorCode::kConfiguration, "wlan0 has no address");
  EXPECT_EQ(address.look(false, none), Event::kGone);
  EXPECT_EQ(address.look(false, wire::NetworkPath{}), Event::kNone);
  EXPECT_EQ(address.look(false, kAfter), Event::kMoved);
  EXPECT_EQ(address.look(false, kAfter), Event::kNone);
  EXPECT_EQ(address.look(true, kBefore), Event::kNone) << "it is back";
  EXPECT_EQ(address.look(false, none), Event::kGone);
}

TEST(OwnAddress, WhereTheProfileNamesWhatWeDoNotKnowNothingIsJudged) {
  OwnAddress address(wire::NetworkPath{});
  EXPECT_EQ(address.look(false, kAfter), Event::kNone);
}

}  // namespace
}  // namespace cairn
