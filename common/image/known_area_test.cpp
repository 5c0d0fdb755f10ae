// SPDX-License-Identifier: Apache-2.0
#include "common/image/known_area.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(KnownArea, TheShareOfTexturedCellsWithoutAMeasurement) {
  KnownArea area(320, 240);  // cells of 40 x 40
  EXPECT_EQ(area.unknown_fraction(), 0) << "nothing to be known";
  for (int column = 0; column < 4; ++column) {
    for (int corner = 0; corner < 3; ++corner) area.add_corner(static_cast<float>(40 * column + corner), 10);
  }
  area.add_corner(300, 200);  // one corner is no texture
  EXPECT_EQ(area.unknown_fraction(), 1);
  area.add_measurement(39, 39);
  EXPECT_EQ(area.unknown_fraction(), 0.75);
  area.add_measurement(300, 200);
  EXPECT_EQ(area.unknown_fraction(), 0.75) << "a cell without texture does not count";
  area.add_measurement(-5, 1000);  // a rounding beyond the border falls into a cell
}

}  // namespace
}  // namespace cairn
