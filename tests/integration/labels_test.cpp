// SPDX-License-Identifier: Apache-2.0
// Labels on their way between the clients of a map, and into the store.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client/session/label_request.h"
#include "tests/integration/store_folder.h"
#include "tests/integration/test_domain.h"
#include "tests/integration/two_views.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using testing::eventually;
using ::testing::HasSubstr;

class LabelsTest : public ::testing::Test {
 protected:
  LabelsTest() {
    service_options_.store = folder_.path();
    service_ = testing::start_service(&service_options_);
    anna_ = open("anna");
  }
  std::unique_ptr<Session> open(const std::string& name, bool reads_only = false) {
    SessionOptions options;
    options.domain = service_options_.domain;
    options.name = name;
    options.reads_only = reads_only;
    auto session = testing::open_session(options, scene_.camera());
    EXPECT_TRUE(session->wait_for_server(60s));
    EXPECT_TRUE(session->wait_for_name(60s));
    return session;
  }
  void make_map() {
    anna_->send_seed(testing::make_seed(scene_));
    ASSERT_TRUE(anna_->wait_for_map(60s)) << anna_->status().text;
    map_ = anna_->snapshot()->map;
  }
  std::unique_ptr<Session> open_reader(const std::string& name, bool reads_only = false) {
    auto session = open(name, reads_only);
    session->use_map(map_);
    EXPECT_TRUE(session->wait_for_map(60s));
    return session;
  }

  std::optional<RequestReply> ask(Session& session, wire::ClientRequest request) {
    session.send_request(std::move(request));
    std::vector<RequestReply> replies;
    (void)eventually([&] { return !(replies = session.take_request_replies()).empty(); });
    return replies.size() == 1 ? std::optional(replies.front()) : std::nullopt;
  }
  /// A label at what the second keyframe sees at a pixel.
  wire::ClientRequest new_label(const std::string& text) {
    const MapSnapshot& map = *anna_->snapshot();
    const SE3& camera_from_map = map.find(KeyframeId{2})->camera_from_map;
    const Eigen::Vector3d place = camera_from_map.inverse() * Eigen::Vector3d(0.1, 0.05, 1);
    return *request_new_label(map, camera_from_map, place, text);
  }
  LabelId add(Session& session, const std::string& text) {
    const auto reply = ask(session, new_label(text));
    EXPECT_TRUE(reply && reply->done) << (reply ? reply->reason : "no reply");
    return reply ? reply->label : LabelId{};
  }
  std::vector<std::string> texts(const Session& session) {
    std::vector<std::string> found;
    if (const LabelListPtr labels = session.labels(map_)) {
      for (const Label& label : *labels) found.push_back(label.text);
    }
    return found;
  }
  using Texts = std::vector<std::string>;

  const testing::Scene scene_{11};
  const testing::StoreFolder folder_{"labels"};
  ServiceOptions service_options_;
  std::unique_ptr<Service> service_;
  std::unique_ptr<Session> anna_;
  MapId map_;
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
  auto again = Service::start(service_options_, null_logger());
  ASSERT_TRUE(again) << again.error().message;
  service_ = std::move(*again);
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
  auto again = Service::start(service_options_, null_logger());
  ASSERT_TRUE(again) << again.error().message;
  service_ = std::move(*again);
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
