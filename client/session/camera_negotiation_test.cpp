// SPDX-License-Identifier: Apache-2.0
#include "client/session/camera_negotiation.h"

#include <gtest/gtest.h>

#include "common/geometry/camera_guess.h"

namespace cairn {
namespace {

constexpr ClientId kClient{5};
const MapId kDesk{{7}};
const MapId kBench{{8}};

/// A camera of which focal length is believed to 10 %, k1 to 0.05, and maps that self-calibrate it.
class CameraNegotiationTest : public ::testing::Test {
 protected:
  static IntrinsicsPrior believed(double focal_length = 500) {
    return {{CameraModel::kPinholeRadtan, 640, 480, {focal_length, focal_length, 320, 240, 0, 0, 0, 0, 0}},
            0.1,
            0.05};
  }
  [[nodiscard]] wire::CameraEstimate estimate(MapId map, uint32_t version, double focal_length,
                                              bool frozen = false) const {
    IntrinsicsPrior found = believed(focal_length);
    found.focal_sigma = 0.01;
    return {kClient,          negotiation_.in_use().camera, map,    Epoch{1}, version,
            found.parameters, sigma_of_values(found),       frozen, false};
  }
  [[nodiscard]] MapSnapshot revision_with(MapId map, uint32_t version) const {
    MapSnapshot made;
    made.map = map;
    made.epoch = Epoch{1};
    made.cameras = {{kClient, negotiation_.in_use().camera, version}};
    return made;
  }

  CameraNegotiation negotiation_{kClient, sigma_of_values(believed()), *make_camera(believed().parameters)};
};

TEST_F(CameraNegotiationTest, ARevisionWaitsForTheValuesItWasMadeWithOrLaterOnes) {
  EXPECT_FALSE(negotiation_.has_values_of(revision_with(kDesk, 2)));
  ASSERT_TRUE(negotiation_.take(estimate(kDesk, 1, 510)));
  EXPECT_FALSE(negotiation_.has_values_of(revision_with(kDesk, 2)));
  ASSERT_TRUE(negotiation_.take(estimate(kDesk, 3, 520)));
  EXPECT_TRUE(negotiation_.has_values_of(revision_with(kDesk, 2)));
  EXPECT_FALSE(negotiation_.has_values_of(revision_with(kBench, 1))) << "each map counts its own";
}

TEST_F(CameraNegotiationTest, ValuesInUseAreAnnouncedUnderANewVersionWithTheSigmaOfTheBeginning) {
  ASSERT_TRUE(negotiation_.next_announcement());
  negotiation_.written(true);
  EXPECT_FALSE(negotiation_.next_announcement());
  ASSERT_TRUE(negotiation_.take(estimate(kDesk, 1, 510)));
  const uint32_t before = negotiation_.in_use().version;
  const auto update = negotiation_.use_values_of(revision_with(kDesk, 1));
  ASSERT_TRUE(update);
  EXPECT_DOUBLE_EQ(update->camera->focal_length(), 510);
  EXPECT_FALSE(negotiation_.use_values_of(revision_with(kDesk, 1))) << "they are in use";
  const auto announced = negotiation_.next_announcement();
  ASSERT_TRUE(announced);
  EXPECT_EQ(announced->version, before + 1);
  EXPECT_NEAR(announced->sigma.at(0), 51, 1e-9) << "a map's belief is no knowledge of the next one's";
}

TEST_F(CameraNegotiationTest, WhatAMapMerelyBelievedIsNotHandedOn) {
  EXPECT_FALSE(negotiation_.use_first_values()) << "they are in use";
  ASSERT_TRUE(negotiation_.take(estimate(kDesk, 1, 510)));
  ASSERT_TRUE(negotiation_.use_values_of(revision_with(kDesk, 1)));
  const auto first = negotiation_.use_first_values();
  ASSERT_TRUE(first);
  EXPECT_DOUBLE_EQ(first->camera->focal_length(), 500);
}

TEST_F(CameraNegotiationTest, WhatIsKnownStays) {
  ASSERT_TRUE(negotiation_.take(estimate(kDesk, 1, 510, true)));
  ASSERT_TRUE(negotiation_.use_values_of(revision_with(kDesk, 1)));
  EXPECT_FALSE(negotiation_.use_first_values());
  EXPECT_TRUE(negotiation_.has_values_of(revision_with(kBench, 4))) << "no map changes it any more";
  EXPECT_TRUE(negotiation_.in_use().frozen);
}

TEST_F(CameraNegotiationTest, ValuesThatCannotBeAreRefusedAndSaidOnce) {
  EXPECT_FALSE(negotiation_.take(estimate(kDesk, 1, 5)));
  EXPECT_TRUE(negotiation_.is_unsound(kDesk));
  EXPECT_TRUE(negotiation_.take(estimate(kDesk, 1, 5)));
  EXPECT_FALSE(negotiation_.has_values_of(revision_with(kDesk, 1)));
  EXPECT_TRUE(negotiation_.take(estimate(kDesk, 2, 510)));
  EXPECT_FALSE(negotiation_.is_unsound(kDesk));
}

TEST_F(CameraNegotiationTest, ValuesThatComeIntoUseWhileOthersAreWrittenAreAnnouncedToo) {
  ASSERT_TRUE(negotiation_.next_announcement());
  ASSERT_TRUE(negotiation_.take(estimate(kDesk, 1, 510)));
  ASSERT_TRUE(negotiation_.use_values_of(revision_with(kDesk, 1)));
  negotiation_.written(true);
  EXPECT_FALSE(negotiation_.is_announced());
  EXPECT_TRUE(negotiation_.next_announcement());
}

}  // namespace
}  // namespace cairn
