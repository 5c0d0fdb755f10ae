// SPDX-License-Identifier: Apache-2.0
#include "server/service/proposal_book.h"

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

std::vector<uint64_t> numbers(const ProposalBook& book, MapId map = kDesk) {
  std::vector<uint64_t> all;
  for (const auto& [number, each] : book.of(map)) all.push_back(number);
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

TEST(ProposalBook, TheOldestOfAClientGoesForItsNewest) {
  ProposalBook book(limits(2, 100));
  EXPECT_THAT(book.add(kDesk, proposal("anna")).gone, IsEmpty());
  EXPECT_THAT(book.add(kDesk, proposal("bob")).gone, IsEmpty());
  EXPECT_THAT(book.add(kDesk, proposal("anna")).gone, IsEmpty());
  const auto room = book.add(kDesk, proposal("anna"));
  EXPECT_EQ(room.number, 4U);
  EXPECT_THAT(numbers(room.gone), ElementsAre(1));
  EXPECT_THAT(numbers(book), ElementsAre(2, 3, 4));
}

TEST(ProposalBook, InAFullMapWhoHasTheMostMakesRoom) {
  ProposalBook book(limits(100, 3));
  (void)book.add(kDesk, proposal("bob"));
  (void)book.add(kDesk, proposal("anna"));
  (void)book.add(kDesk, proposal("anna"));
  EXPECT_THAT(numbers(book.add(kDesk, proposal("carl")).gone), ElementsAre(2)) << "not bob's, which is older";
  EXPECT_THAT(book.add(kBench, proposal("carl")).gone, IsEmpty()) << "another map has room of its own";
}

TEST(ProposalBook, BytesAreBoundedAsWell) {
  ProposalLimits few;
  few.bytes_per_client = 100;
  few.bytes_in_all = 150;
  ProposalBook book(few);
  (void)book.add(kDesk, proposal("anna", 0, 60));
  EXPECT_THAT(numbers(book.add(kDesk, proposal("anna", 0, 60)).gone), ElementsAre(1));
  EXPECT_EQ(book.why_full(), "");
  (void)book.add(kBench, proposal("bob", 0, 95));
  EXPECT_THAT(book.why_full(), HasSubstr("no more until some have been accepted or dropped"));
}

TEST(ProposalBook, WhatCannotBeKeptHasNotHappened) {
  ProposalBook book(limits(1, 100));
  (void)book.add(kDesk, proposal("anna"));
  const auto room = book.add(kDesk, proposal("anna"));
  book.take_back(kDesk, room);
  EXPECT_THAT(numbers(book), ElementsAre(1));
  EXPECT_EQ(book.add(kDesk, proposal("bob")).number, 3U) << "no number comes again";
}

TEST(ProposalBook, OneThatShowsTheSameIsKnown) {
  ProposalBook book;
  (void)book.add(kDesk, proposal("anna", 0));
  EXPECT_NE(book.find_alike(kDesk, proposal("bob", 0.05)), nullptr);
  EXPECT_EQ(book.find_alike(kDesk, proposal("bob", 0.2)), nullptr);
  EXPECT_EQ(book.find_alike(kBench, proposal("bob", 0.05)), nullptr);
  ProposalSummary turned = proposal("bob", 0);
  turned.camera_from_map =
      SE3(Eigen::Quaterniond(Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitY())), Eigen::Vector3d::Zero());
  EXPECT_EQ(book.find_alike(kDesk, turned), nullptr);
}

TEST(ProposalBook, AClientIsLookedAtOnceInAnInterval) {
  ProposalBook book;
  const MonotonicTime now{};
  EXPECT_EQ(book.why_not_now("anna", now), "");
  EXPECT_THAT(book.why_not_now("anna", now + milliseconds(500)), HasSubstr("too fast"));
  EXPECT_EQ(book.why_not_now("bob", now + milliseconds(500)), "");
  EXPECT_EQ(book.why_not_now("anna", now + milliseconds(2000)), "");
}

TEST(ProposalBook, WhatComesFromTheStoreGoesOn) {
  ProposalBook book;
  ProposalSummary kept = proposal("anna");
  kept.number = 4;
  kept.received = Timestamp{1};
  book.restore(kDesk, {kept}, 9);
  EXPECT_EQ(book.add(kDesk, proposal("bob")).number, 10U);
  const int64_t day = std::chrono::nanoseconds(std::chrono::hours(24)).count();
  EXPECT_THAT(book.too_old(Timestamp{29 * day})[kDesk], IsEmpty());
  EXPECT_THAT(book.too_old(Timestamp{31 * day})[kDesk], ElementsAre(4, 10));
  EXPECT_EQ(book.count(), 2U);
  book.forget(kDesk);
  EXPECT_EQ(book.count(), 0U);
  EXPECT_EQ(proposal_id(kDesk, 12), "3e6f01ab-12");
}

}  // namespace
}  // namespace cairn
