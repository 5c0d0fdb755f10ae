// SPDX-License-Identifier: Apache-2.0
#include "client/session/map_directory.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

const MapId kDesk{{7}};
const MapId kBench{{3}};
const ServerId kServer{{1}};

TEST(MapDirectory, FindsAMapByNameWhereTheServerInSightHasIt) {
  LinkMonitor monitor;
  MapDirectory directory;
  (void)monitor.heard(kServer);
  const auto list = [&](MapId map, const char* name) {
    monitor.map_listed(map, kServer);
    directory.listed(map, name);
  };
  EXPECT_FALSE(directory.find("desk", monitor));
  list(kBench, "bench");
  list(kDesk, "desk");
  list(kBench, "bench");  // has grown
  EXPECT_EQ(directory.find("desk", monitor), kDesk);
  EXPECT_EQ(directory.find("bench", monitor), kBench);
  EXPECT_FALSE(directory.find("robot", monitor));
  directory.removed(kDesk);
  EXPECT_FALSE(directory.find("desk", monitor));
  monitor.map_removed(kBench);
  EXPECT_FALSE(directory.find("bench", monitor)) << "the server in sight does not have it";
}

}  // namespace
}  // namespace cairn
