// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/map_maker_options.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(MapMakerOptions, DefaultsAreInTheirRanges) {
  const Status checked = check_options(MapMakerOptions());
  EXPECT_TRUE(checked) << checked.error().message;
}

TEST(MapMakerOptions, EachMemberIsListedOnce) {
  MapMakerOptions options;
  const Status complete = list_options(&options).check_complete();
  EXPECT_TRUE(complete) << complete.error().message;
}

}  // namespace
}  // namespace cairn
