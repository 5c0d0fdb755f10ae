// SPDX-License-Identifier: Apache-2.0
#include "common/base/histogram.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>
#include <vector>

namespace cairn {
namespace {

TEST(Histogram, PercentilesAreThoseOfTheSortedValuesToHalfAPerCent) {
  std::mt19937 random(1);
  std::lognormal_distribution<double> times(1.0, 1.5);
  std::vector<double> values(10'000);
  Histogram histogram;
  for (double& value : values) histogram.add(value = times(random));
  std::sort(values.begin(), values.end());
  EXPECT_EQ(histogram.count(), values.size());
  for (const double p : {0.01, 0.25, 0.5, 0.95, 0.99, 1.0}) {
    const auto rank = static_cast<size_t>(std::ceil(p * static_cast<double>(values.size())));
    EXPECT_NEAR(histogram.percentile(p) / values[rank - 1], 1, 0.0051) << p;
  }
}

TEST(Histogram, OfNothingIsZeroAndOfOneValueIsThatValue) {
  Histogram histogram;
  EXPECT_EQ(histogram.percentile(0.5), 0);
  histogram.add(7);
  for (const double p : {0.0, 0.5, 1.0}) EXPECT_DOUBLE_EQ(histogram.percentile(p), 7);
}

TEST(Histogram, ValuesBeyondItsRangeCountAtTheEnds) {
  Histogram histogram;
  for (const double value : {0.0, -1.0, 1e-9, 5.0}) histogram.add(value);
  EXPECT_LE(histogram.percentile(0.5), 1.01e-3);
  EXPECT_NEAR(histogram.percentile(1), 5, 0.05);
}

TEST(Histogram, OneThatIsMovedFromIsOfNothing) {
  Histogram histogram;
  histogram.add(7);
  const Histogram taken = std::move(histogram);
  EXPECT_EQ(taken.count(), 1U);
  EXPECT_EQ(histogram.count(), 0U);  // NOLINT(bugprone-use-after-move): what the test is about
  histogram.add(3);
  EXPECT_DOUBLE_EQ(histogram.percentile(0.5), 3);
}

}  // namespace
}  // namespace cairn
