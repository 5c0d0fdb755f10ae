// SPDX-License-Identifier: Apache-2.0
#include "server/service/pending_offers.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

const MapId kDesk{{1}};
const MapId kBench{{2}};

TEST(PendingOffers, WhatWaitsIsWithdrawnByMapAndExtentAndNothingElse) {
  PendingOffers offers;
  const auto bytes = std::make_shared<std::atomic<size_t>>(0);
  const auto to_desk = offers.add(kDesk, std::nullopt, 1, bytes);
  const auto within = offers.add(kDesk, Sphere{{0, 0, 0}, 1}, 10, bytes);
  const auto to_bench = offers.add(kBench, std::nullopt, 100, bytes);
  (void)offers.add(kDesk, std::nullopt, 1000, bytes);  // judged already: nobody holds it
  EXPECT_EQ(*bytes, 111U);
  int asked = 0;
  offers.withdraw([&](const MapId& map, const std::optional<Extent>& extent) {
    ++asked;
    return map == kDesk && extent.has_value();
  });
  EXPECT_EQ(asked, 3);
  EXPECT_FALSE(to_desk->is_withdrawn());
  EXPECT_TRUE(within->is_withdrawn());
  EXPECT_FALSE(to_bench->is_withdrawn());
  offers.withdraw([](const MapId& map, const auto&) { return map == kDesk; });
  EXPECT_TRUE(to_desk->is_withdrawn());
  EXPECT_FALSE(to_bench->is_withdrawn());
  EXPECT_FALSE(offers.add(kDesk, std::nullopt, 1, bytes)->is_withdrawn())
      << "what is offered then is another matter";
}

}  // namespace
}  // namespace cairn
