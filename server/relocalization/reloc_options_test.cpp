// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "server/relocalization/relocalizer.h"

namespace cairn {
namespace {

TEST(RelocOptions, DefaultsAreInTheirRanges) {
  const Status checked = check_options(RelocOptions());
  EXPECT_TRUE(checked) << checked.error().message;
}

TEST(RelocOptions, EachMemberIsListedOnce) {
  RelocOptions options;
  const Status complete = list_options(&options).check_complete();
  EXPECT_TRUE(complete) << complete.error().message;
}

}  // namespace
}  // namespace cairn
