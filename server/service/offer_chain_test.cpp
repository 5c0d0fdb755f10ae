// SPDX-License-Identifier: Apache-2.0
#include "server/service/offer_chain.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(OfferChain, KnowsWhatBecameOfTheOffersOfASessionAndOfNoOther) {
  OfferChain chain;
  chain.put("anna", SessionId{7}, 3, {KeyframeId{5}, SE3()});
  ASSERT_NE(chain.find("anna", SessionId{7}, 3), nullptr);
  EXPECT_EQ(chain.find("anna", SessionId{7}, 3)->keyframe, KeyframeId{5});
  EXPECT_EQ(chain.find("anna", SessionId{7}, 2), nullptr);
  EXPECT_EQ(chain.find("anna", SessionId{8}, 3), nullptr) << "another session counts anew";
  EXPECT_EQ(chain.find("bert", SessionId{7}, 3), nullptr);
  chain.put("anna", SessionId{8}, 1, {KeyframeId{6}, SE3()});
  EXPECT_EQ(chain.find("anna", SessionId{7}, 3), nullptr) << "its session is over";
}

TEST(OfferChain, IsBounded) {
  OfferChain chain;
  for (uint64_t i = 1; i <= 2 * OfferChain::kRemembered; ++i)
    chain.put("anna", SessionId{7}, i, {KeyframeId{i}, SE3()});
  EXPECT_EQ(chain.find("anna", SessionId{7}, OfferChain::kRemembered), nullptr);
  EXPECT_NE(chain.find("anna", SessionId{7}, OfferChain::kRemembered + 1), nullptr);
  for (size_t i = 0; i + 1 < OfferChain::kMostClients; ++i)
    chain.put("aa-client-" + std::to_string(i), SessionId{1}, 1, {KeyframeId{1}, SE3()});
  EXPECT_NE(chain.find("anna", SessionId{7}, 2 * OfferChain::kRemembered), nullptr);
  chain.put("aa", SessionId{1}, 1, {KeyframeId{1}, SE3()});
  EXPECT_EQ(chain.find("anna", SessionId{7}, 2 * OfferChain::kRemembered), nullptr) << "silent for longest";
  EXPECT_NE(chain.find("aa-client-0", SessionId{1}, 1), nullptr);
}

}  // namespace
}  // namespace cairn
