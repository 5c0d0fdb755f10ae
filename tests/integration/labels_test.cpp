// SPDX-License-Identifier: Apache-2.0
// Labels on their way between the clients of a map, and into the store.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/integration/label_fixture.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using testing::eventually;
using ::testing::HasSubstr;

class LabelsTest : public testing::LabelFixture {
 protected:
  std::unique_ptr<Session> open_reader(const std::string& name, bool reads_only = false) {
    auto session = open(name, reads_only);
    session->use_map(map_);
    EXPECT_TRUE(session->wait_for_map(60s));
    return session;
  }
};

TEST_F(LabelsTest, WhatOneSaysAllOfTheMapReadWithinASecond) {
  make_map();
  const auto bob = open_reader("bob");
  const auto asked = std::chrono::steady_clock::now();
  const LabelId vice = add(*anna_, "vice");
  ASSERT_TRUE(eventually([&] { return texts(*bob) == Texts{"vice"} && texts(*anna_) == Texts{"vice"}; }));
  EXPECT_LT(std::chrono::steady_clock::now() - asked, 1s);
  const Label label = bob->labels(map_)->front();
  EXPECT_EQ(label.id, vice);
  EXPECT_EQ(label.author, "anna");

  (void)add(*bob, "drill");
  ASSERT_TRUE(eventually([&] { return texts(*anna_) == Texts{"vice", "drill"}; }));
  auto reply = ask(*bob, request_label_text(map_, vice, "small vice"));
  EXPECT_TRUE(reply && reply->done);
  ASSERT_TRUE(eventually([&] { return texts(*anna_) == Texts{"small vice", "drill"}; }));
  reply = ask(*anna_, request_label_removal(map_, vice));
  EXPECT_TRUE(reply && reply->done);
  ASSERT_TRUE(eventually([&] { return texts(*bob) == Texts{"drill"} && texts(*anna_) == Texts{"drill"}; }));
  const auto carl = open_reader("carl");
  EXPECT_TRUE(eventually([&] { return texts(*carl) == Texts{"drill"}; })) << "who comes late reads it too";
}

TEST_F(LabelsTest, ALabelRidesOnItsKeyframeWhileTheMapGrows) {
  make_map();
  const wire::ClientRequest request = new_label("vice");
  ASSERT_TRUE(ask(*anna_, request)->done);
  for (const int step : {4, 6, 8}) {
    const size_t keyframes = anna_->snapshot()->keyframe_count();
    testing::Frame frame = testing::make_offer(scene_, *anna_->snapshot(), step);
    anna_->send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{step});
    ASSERT_TRUE(eventually([&] { return anna_->snapshot()->keyframe_count() > keyframes; }));
  }
  const Eigen::Vector3d place = request.reference_from_label.translation();
  EXPECT_TRUE(eventually([&] {
    const LabelListPtr labels = anna_->labels(map_);
    const KeyframePose* keyframe = anna_->snapshot()->find(request.reference);
    if (labels == nullptr || labels->size() != 1 || keyframe == nullptr) return false;
    const Eigen::Vector3d now = keyframe->camera_from_map * labels->front().map_from_label.translation();
    return (now - place).norm() < 1e-3 * place.norm();  // 0.5 px; moves of less than 0.2 px are not told
  }));
}

TEST_F(LabelsTest, LabelsSurviveTheServerAndRemovedOnesStayRemoved) {
  make_map();
  const auto bob = open_reader("bob");
  const wire::ClientRequest request = new_label("vice");
  ASSERT_TRUE(ask(*anna_, request)->done);
  const LabelId gone = add(*anna_, "mistake");
  ASSERT_TRUE(eventually([&] { return texts(*bob).size() == 2U; }));
  ASSERT_TRUE(ask(*anna_, request_label_removal(map_, gone))->done);
  const Epoch before = anna_->snapshot()->epoch;

  service_.reset();
  EXPECT_EQ(texts(*bob), Texts{"vice"}) << "they stay while the server is away";
  start_service_again();
  ASSERT_TRUE(eventually([&] { return anna_->snapshot()->epoch > before; }));
  ASSERT_TRUE(eventually([&] { return texts(*anna_) == Texts{"vice"} && texts(*bob) == Texts{"vice"}; }));
  const MapSnapshotPtr map = anna_->snapshot();
  const Eigen::Vector3d place = map->find(request.reference)->camera_from_map *
                                anna_->labels(map_)->front().map_from_label.translation();
  EXPECT_LT((place - request.reference_from_label.translation()).norm(), 1e-3);
  ASSERT_TRUE(eventually([&] { return anna_->status().link == ServerLink::kConnected; }));
  (void)add(*anna_, "drill");
  EXPECT_TRUE(eventually([&] { return texts(*bob) == (Texts{"vice", "drill"}); }));
}

TEST_F(LabelsTest, WhatWasAskedWhileTheServerIsAwayIsDoneOnceWhenItIsBack) {
  make_map();
  (void)add(*anna_, "vice");
  const wire::ClientRequest drill = request_label_text(map_, LabelId{1}, "drill");
  service_.reset();
  ASSERT_TRUE(eventually([&] { return anna_->status().link == ServerLink::kGone; }));
  anna_->send_request(drill);
  EXPECT_TRUE(anna_->take_request_replies().empty());
  start_service_again();
  std::vector<RequestReply> replies;
  ASSERT_TRUE(eventually([&] { return !(replies = anna_->take_request_replies()).empty(); }));
  EXPECT_TRUE(replies[0].done) << replies[0].reason;
  EXPECT_TRUE(eventually([&] { return texts(*anna_) == Texts{"drill"}; }));
}

TEST_F(LabelsTest, AReaderReadsAndChangesNothing) {
  make_map();
  const LabelId vice = add(*anna_, "vice");
  const auto reader = open_reader("visitor", true);
  ASSERT_TRUE(eventually([&] { return texts(*reader) == Texts{"vice"}; }));
  for (const wire::ClientRequest& request :
       {new_label("mine"), request_label_text(map_, vice, "mine"), request_label_removal(map_, vice)}) {
    const auto reply = ask(*reader, request);
    ASSERT_TRUE(reply.has_value());
    EXPECT_FALSE(reply->done);
    EXPECT_THAT(reply->reason, HasSubstr("reader"));
  }
  EXPECT_EQ(texts(*anna_), Texts{"vice"});
}

TEST_F(LabelsTest, ARefusalSaysWhy) {
  make_map();
  auto reply = ask(*anna_, request_label_removal(map_, LabelId{77}));
  ASSERT_TRUE(reply && !reply->done);
  EXPECT_THAT(reply->reason, HasSubstr("no such label"));
  reply = ask(*anna_, request_label_removal(MapId{{9}}, LabelId{1}));
  ASSERT_TRUE(reply && !reply->done);
  EXPECT_THAT(reply->reason, HasSubstr("does not know the map"));
  reply = ask(*anna_, new_label("   "));
  ASSERT_TRUE(reply && !reply->done);
  EXPECT_THAT(reply->reason, HasSubstr("needs a text"));
}

}  // namespace
}  // namespace cairn
