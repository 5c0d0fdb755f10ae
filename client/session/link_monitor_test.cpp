// SPDX-License-Identifier: Apache-2.0
#include "client/session/link_monitor.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

using Event = LinkMonitor::Event;

const ServerId kFirst{{1}};
const ServerId kSecond{{2}};
const MapId kMap{{7}};

TEST(LinkMonitor, SaysEachChangeOnce) {
  LinkMonitor monitor;
  EXPECT_EQ(monitor.link(), ServerLink::kConnecting);
  EXPECT_EQ(monitor.alive(false), Event::kNone) << "a server that was never there cannot go";
  EXPECT_EQ(monitor.heard(kFirst), Event::kConnected);
  EXPECT_EQ(monitor.heard(kFirst), Event::kNone);
  EXPECT_EQ(monitor.alive(true), Event::kNone);
  EXPECT_EQ(monitor.alive(false), Event::kGone);
  EXPECT_EQ(monitor.alive(false), Event::kNone);
  EXPECT_EQ(monitor.link(), ServerLink::kGone);
  EXPECT_EQ(monitor.heard(kFirst), Event::kReturned);
  EXPECT_EQ(monitor.heard(kSecond), Event::kRestarted) << "also without a silence between";
  EXPECT_EQ(monitor.link(), ServerLink::kConnected);
}

TEST(LinkMonitor, ARestartedServerHasOnlyTheMapsItListsItself) {
  LinkMonitor monitor;
  (void)monitor.heard(kFirst);
  monitor.map_listed(kMap, kFirst);
  EXPECT_TRUE(monitor.knows(kMap));
  (void)monitor.heard(kSecond);
  EXPECT_FALSE(monitor.knows(kMap));
  monitor.map_listed(kMap, kFirst);  // a late listing by the old server
  EXPECT_FALSE(monitor.knows(kMap));
  monitor.map_listed(kMap, kSecond);
  EXPECT_TRUE(monitor.knows(kMap));
  monitor.map_removed(kMap);
  EXPECT_FALSE(monitor.knows(kMap));
}

TEST(LinkMonitor, AListingThatComesBeforeTheStatusCounts) {
  LinkMonitor monitor;
  (void)monitor.heard(kFirst);
  monitor.map_listed(kMap, kSecond);
  (void)monitor.heard(kSecond);
  EXPECT_TRUE(monitor.knows(kMap));
}

}  // namespace
}  // namespace cairn
