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
  EXPECT_EQ(monitor.heard(kFirst, 1), Event::kConnected);
  EXPECT_EQ(monitor.heard(kFirst, 1), Event::kNone);
  EXPECT_EQ(monitor.alive(true), Event::kNone);
  EXPECT_EQ(monitor.alive(false), Event::kGone);
  EXPECT_EQ(monitor.alive(false), Event::kNone);
  EXPECT_EQ(monitor.link(), ServerLink::kGone);
  EXPECT_EQ(monitor.heard(kFirst, 1), Event::kReturned);
  EXPECT_EQ(monitor.heard(kSecond, 1), Event::kRestarted) << "also without a silence between";
  EXPECT_EQ(monitor.link(), ServerLink::kConnected);
}

TEST(LinkMonitor, AServerThatHasKeptWhatItHadIsTheSame) {
  LinkMonitor monitor;
  (void)monitor.heard(kFirst, 1);
  monitor.map_listed(kMap, kFirst);
  EXPECT_EQ(monitor.heard(kFirst, 2), Event::kReturned) << "also without a silence between";
  EXPECT_EQ(monitor.heard(kFirst, 2), Event::kNone);
  EXPECT_TRUE(monitor.knows(kMap));
}

TEST(LinkMonitor, ARestartedServerHasOnlyTheMapsItListsItself) {
  LinkMonitor monitor;
  (void)monitor.heard(kFirst, 1);
  monitor.map_listed(kMap, kFirst);
  EXPECT_TRUE(monitor.knows(kMap));
  (void)monitor.heard(kSecond, 1);
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
  (void)monitor.heard(kFirst, 1);
  monitor.map_listed(kMap, kSecond);
  (void)monitor.heard(kSecond, 1);
  EXPECT_TRUE(monitor.knows(kMap));
}

}  // namespace
}  // namespace cairn
