// SPDX-License-Identifier: Apache-2.0
#include "server/service/pending_offers.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

using Kind = PendingOffers::Kind;
const MapId kDesk{{1}};
const MapId kBench{{2}};

TEST(PendingOffers, WhatWaitsIsWithdrawnByKindMapAndExtentAndNothingElse) {
  PendingOffers offers;
  const auto bytes = std::make_shared<std::atomic<size_t>>(0);
  const auto to_desk = offers.add({Kind::kKeyframe, kDesk, {}}, 1, bytes);
  const auto within = offers.add({Kind::kKeyframe, kDesk, Sphere{{0, 0, 0}, 1}}, 10, bytes);
  const auto to_bench = offers.add({Kind::kProposal, kBench, {}}, 100, bytes);
  (void)offers.add({Kind::kKeyframe, kDesk, {}}, 1000, bytes);  // judged already: nobody holds it
  EXPECT_EQ(*bytes, 111U);
  int asked = 0;
  offers.withdraw([&](const PendingOffers::What& what) {
    ++asked;
    return what.map == kDesk && what.extent.has_value();
  });
  EXPECT_EQ(asked, 3);
  EXPECT_FALSE(to_desk->is_withdrawn());
  EXPECT_TRUE(within->is_withdrawn());
  EXPECT_FALSE(to_bench->is_withdrawn());
  offers.withdraw([](const PendingOffers::What& what) { return what.kind == Kind::kKeyframe; });
  EXPECT_TRUE(to_desk->is_withdrawn());
  EXPECT_FALSE(to_bench->is_withdrawn());
  EXPECT_FALSE(offers.add({Kind::kKeyframe, kDesk, {}}, 1, bytes)->is_withdrawn())
      << "what is offered then is another matter";
}

}  // namespace
}  // namespace cairn
