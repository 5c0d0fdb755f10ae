// SPDX-License-Identifier: Apache-2.0
#include "server/service/proposal_registry.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cairn {
namespace {

using std::chrono::milliseconds;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const MapId kDesk{{0x3e, 0x6f, 0x01, 0xab}};
const MapId kBench{{2}};

ProposalSummary proposal(const std::string& client, double x = 0, uint64_t bytes = 10) {
  ProposalSummary made;
  made.client = client;
  made.camera_from_map = SE3(Eigen::Quaterniond::Identity(), {-x, 0, 0});
  made.mean_depth = 1;
  made.bytes = bytes;
  return made;
}

std::vector<uint64_t> numbers(const ProposalRegistry& registry, MapId map = kDesk) {
  std::vector<uint64_t> all;
  for (const auto& [number, each] : registry.of(map)) all.push_back(number);
  return all;
}

std::vector<uint64_t> numbers(const std::vector<ProposalSummary>& gone) {
  std::vector<uint64_t> all;
  for (const auto& each : gone) all.push_back(each.number);
  return all;
}

ProposalLimits limits(size_t per_client, size_t per_map) {
  ProposalLimits made;
  made.per_client = per_client;
  made.per_map = per_map;
  return made;
}

TEST(ProposalRegistry, TheOldestOfAClientGoesForItsNewest) {
  ProposalRegistry registry(limits(2, 100));
  EXPECT_THAT(registry.add(kDesk, proposal("anna")).gone, IsEmpty());
  EXPECT_THAT(registry.add(kDesk, proposal("bob")).gone, IsEmpty());
  EXPECT_THAT(registry.add(kDesk, proposal("anna")).gone, IsEmpty());
  const auto room = registry.add(kDesk, proposal("anna"));
  EXPECT_EQ(room.number, 4U);
  EXPECT_THAT(numbers(room.gone), ElementsAre(1));
  EXPECT_THAT(numbers(registry), ElementsAre(2, 3, 4));
}

TEST(ProposalRegistry, InAFullMapWhoHasTheMostMakesRoom) {
  ProposalRegistry registry(limits(100, 3));
  (void)registry.add(kDesk, proposal("bob"));
  (void)registry.add(kDesk, proposal("anna"));
  (void)registry.add(kDesk, proposal("anna"));
  EXPECT_THAT(numbers(registry.add(kDesk, proposal("carl")).gone), ElementsAre(2))
      << "not bob's, which is older";
  EXPECT_THAT(registry.add(kBench, proposal("carl")).gone, IsEmpty()) << "another map has room of its own";
}

TEST(ProposalRegistry, BytesAreBoundedAsWell) {
  ProposalLimits few;
  few.bytes_per_client = 100;
  few.bytes_in_all = 150;
  ProposalRegistry registry(few);
  (void)registry.add(kDesk, proposal("anna", 0, 60));
  EXPECT_THAT(numbers(registry.add(kDesk, proposal("anna", 0, 60)).gone), ElementsAre(1));
  EXPECT_EQ(registry.why_full(), "");
  (void)registry.add(kBench, proposal("bob", 0, 95));
  EXPECT_THAT(registry.why_full(), HasSubstr("no more until some have been accepted or dropped"));
}

TEST(ProposalRegistry, WhatCannotBeKeptHasNotHappened) {
  ProposalRegistry registry(limits(1, 100));
  (void)registry.add(kDesk, proposal("anna"));
  const auto room = registry.add(kDesk, proposal("anna"));
  registry.take_back(kDesk, room);
  EXPECT_THAT(numbers(registry), ElementsAre(1));
  EXPECT_EQ(registry.add(kDesk, proposal("bob")).number, 3U) << "no number comes again";
}

TEST(ProposalRegistry, OneThatShowsTheSameIsKnown) {
  ProposalRegistry registry;
  (void)registry.add(kDesk, proposal("anna", 0));
  EXPECT_NE(registry.find_alike(kDesk, proposal("bob", 0.05)), nullptr);
  EXPECT_EQ(registry.find_alike(kDesk, proposal("bob", 0.2)), nullptr);
  EXPECT_EQ(registry.find_alike(kBench, proposal("bob", 0.05)), nullptr);
  ProposalSummary turned = proposal("bob", 0);
  turned.camera_from_map =
      SE3(Eigen::Quaterniond(Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitY())), Eigen::Vector3d::Zero());
  EXPECT_EQ(registry.find_alike(kDesk, turned), nullptr);
}

TEST(ProposalRegistry, AClientIsLookedAtOnceInAnInterval) {
  ProposalRegistry registry;
  const MonotonicTime now{};
  EXPECT_EQ(registry.why_not_now("anna", now), "");
  EXPECT_THAT(registry.why_not_now("anna", now + milliseconds(500)), HasSubstr("too fast"));
  EXPECT_EQ(registry.why_not_now("bob", now + milliseconds(500)), "");
  EXPECT_EQ(registry.why_not_now("anna", now + milliseconds(2000)), "");
}

TEST(ProposalRegistry, WhatComesFromTheStoreGoesOn) {
  ProposalRegistry registry;
  ProposalSummary kept = proposal("anna");
  kept.number = 4;
  kept.received = Timestamp{1};
  registry.restore(kDesk, {kept}, 9);
  EXPECT_EQ(registry.add(kDesk, proposal("bob")).number, 10U);
  const int64_t day = std::chrono::nanoseconds(std::chrono::hours(24)).count();
  EXPECT_THAT(registry.too_old(Timestamp{29 * day})[kDesk], IsEmpty());
  EXPECT_THAT(registry.too_old(Timestamp{31 * day})[kDesk], ElementsAre(4, 10));
  EXPECT_EQ(registry.count(), 2U);
  registry.forget(kDesk);
  EXPECT_EQ(registry.count(), 0U);
  EXPECT_EQ(proposal_id(kDesk, 12), "3e6f01ab-12");
}

}  // namespace
}  // namespace cairn
