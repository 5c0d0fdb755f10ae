// SPDX-License-Identifier: Apache-2.0
// Session and service: from a seed to a replica that equals the server's map, and on.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/image/frame_images.h"
#include "tests/integration/test_domain.h"
#include "tests/integration/two_views.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using testing::eventually;
using ::testing::HasSubstr;

/// Everything that travels, compared bit by bit.
void expect_same_revision(const MapSnapshot& replica, const MapSnapshot& original) {
  EXPECT_EQ(replica.map, original.map);
  EXPECT_EQ(replica.name, original.name);
  EXPECT_EQ(replica.epoch, original.epoch);
  EXPECT_EQ(replica.revision, original.revision);
  EXPECT_EQ(replica.metric, original.metric);
  ASSERT_EQ(replica.keyframe_blocks.size(), original.keyframe_blocks.size());
  for (size_t b = 0; b < original.keyframe_blocks.size(); ++b) {
    EXPECT_EQ(replica.keyframe_blocks[b]->live, original.keyframe_blocks[b]->live);
    EXPECT_EQ(replica.keyframe_blocks[b]->keyframes, original.keyframe_blocks[b]->keyframes);
  }
  ASSERT_EQ(replica.point_blocks.size(), original.point_blocks.size());
  for (size_t b = 0; b < original.point_blocks.size(); ++b) {
    const PointBlock& got = *replica.point_blocks[b];
    const PointBlock& sent = *original.point_blocks[b];
    ASSERT_EQ(got.count, sent.count);
    EXPECT_EQ(got.patches->version, sent.patches->version);
    EXPECT_EQ(got.positions->version, sent.positions->version);
    EXPECT_EQ(got.live, sent.live);
    for (int slot = 0; slot < sent.count; ++slot) {
      EXPECT_EQ(got.source(slot).id, sent.source(slot).id);
      EXPECT_EQ(got.source(slot).pixels, sent.source(slot).pixels);
      EXPECT_EQ(got.source(slot).normal, sent.source(slot).normal);
      EXPECT_EQ(got.position(slot), sent.position(slot));
      EXPECT_EQ(got.visibility(slot).mean_direction, sent.visibility(slot).mean_direction);
    }
  }
}

class SessionTest : public ::testing::Test {
 protected:
  SessionTest() : service_(testing::start_service(&service_options_)) {
    session_options_.domain = service_options_.domain;
    session_options_.name = "anna";
    session_options_.lockstep = true;
    session_ = testing::open_session(session_options_, scene_.camera());
  }

  void seed() {
    ASSERT_TRUE(session_->wait_for_server(60s));
    session_->send_seed(testing::make_seed(scene_));
    ASSERT_TRUE(session_->wait_until_settled(60s)) << session_->status().text;
    const auto reply = session_->take_seed_reply();
    ASSERT_TRUE(reply && reply->answer) << (reply ? reply->reason : "no reply");
    EXPECT_GT(reply->answer->points.size(), 100U);
    EXPECT_EQ(session_->snapshot()->map, reply->answer->map);
    EXPECT_EQ(session_->snapshot()->revision, reply->answer->revision);
  }

  testing::Scene scene_{11};
  ServiceOptions service_options_;
  std::unique_ptr<Service> service_;
  SessionOptions session_options_;
  std::unique_ptr<Session> session_;
};

TEST_F(SessionTest, ASeedBecomesAMapAndItsReplicaEqualsTheServers) {
  seed();
  ASSERT_EQ(service_->maps().size(), 1U);
  expect_same_revision(*session_->snapshot(), *service_->maps()[0]);
  EXPECT_EQ(session_->snapshot()->name, "map-1");
  const SessionStatus status = session_->status();
  EXPECT_EQ(status.link, ServerLink::kConnected);
  EXPECT_TRUE(status.map_known);
  EXPECT_GT(status.bytes_sent, 2U * 400 * 300);
  EXPECT_GT(status.bytes_received, 0U);
}

TEST_F(SessionTest, ARefusedSeedHasAReason) {
  ASSERT_TRUE(session_->wait_for_server(60s));
  session_->send_seed(testing::make_seed_without_parallax(scene_));
  ASSERT_TRUE(session_->wait_until_settled(60s));
  const auto reply = session_->take_seed_reply();
  ASSERT_TRUE(reply.has_value());
  EXPECT_FALSE(reply->answer);
  EXPECT_FALSE(reply->reason.empty());
  EXPECT_EQ(session_->snapshot(), nullptr);
  EXPECT_TRUE(service_->maps().empty());
  seed();  // and the next one may be better
}

TEST_F(SessionTest, InLockstepAnAcceptedKeyframeIsInTheReplicaWhenTheWaitEnds) {
  seed();
  for (const int step : {4, 6}) {
    const MapSnapshotPtr before = session_->snapshot();
    testing::Frame frame = testing::make_offer(scene_, *before, step);
    session_->send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{step});
    ASSERT_TRUE(session_->wait_until_settled(60s));
    const auto replies = session_->take_offer_replies();
    ASSERT_EQ(replies.size(), 1U);
    EXPECT_TRUE(replies[0].accepted) << replies[0].reason;
    EXPECT_GT(session_->snapshot()->revision, before->revision);
    EXPECT_EQ(session_->snapshot()->keyframe_count(), before->keyframe_count() + 1);
    expect_same_revision(*session_->snapshot(), *service_->maps()[0]);
  }
}

TEST_F(SessionTest, InLockstepAMapBegunAfterAnotherIsThereWhenTheWaitEnds) {
  seed();
  testing::Frame frame = testing::make_offer(scene_, *session_->snapshot(), 4);
  session_->send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{4});
  ASSERT_TRUE(session_->wait_until_settled(60s));
  session_->leave_map();
  session_->send_seed(testing::make_seed(testing::Scene(12)));
  ASSERT_TRUE(session_->wait_until_settled(60s)) << session_->status().text;
  const auto reply = session_->take_seed_reply();
  ASSERT_TRUE(reply && reply->answer) << (reply ? reply->reason : "no reply");
  ASSERT_NE(session_->snapshot(), nullptr);
  EXPECT_EQ(session_->snapshot()->map, reply->answer->map);
  EXPECT_EQ(service_->maps().size(), 2U);
}

TEST_F(SessionTest, ARefusedOfferHasAReason) {
  seed();
  testing::Frame frame = testing::make_offer(scene_, *session_->snapshot(), testing::kSecondView);
  session_->send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{9});
  ASSERT_TRUE(session_->wait_until_settled(60s));
  const auto replies = session_->take_offer_replies();
  ASSERT_EQ(replies.size(), 1U);
  EXPECT_FALSE(replies[0].accepted) << "a keyframe stands there already";
  EXPECT_FALSE(replies[0].reason.empty());
}

TEST_F(SessionTest, ASecondProcessUnderOneNameIsRefusedUntilTheFirstHasGone) {
  ASSERT_TRUE(session_->wait_for_server(60s));
  ASSERT_TRUE(eventually([&] { return session_->status().link == ServerLink::kConnected; }));
  seed();  // so its name is held
  auto second = testing::open_session(session_options_, scene_.camera());
  ASSERT_TRUE(eventually([&] { return second->status().link == ServerLink::kRefused; }));
  EXPECT_THAT(second->status().text, HasSubstr("'anna'"));
  EXPECT_EQ(session_->status().link, ServerLink::kConnected);
  second->send_seed(testing::make_seed(scene_));
  EXPECT_FALSE(second->wait_until_settled(1500ms)) << "it is not served";
  EXPECT_EQ(service_->maps().size(), 1U);
  session_.reset();
  EXPECT_TRUE(second->wait_until_settled(60s)) << "the name is free: the seed that waited is judged";
  EXPECT_EQ(second->status().link, ServerLink::kConnected);
  EXPECT_EQ(service_->maps().size(), 2U);
}

std::shared_ptr<const PlaceView> view_of(const GrayImage& image) {
  FrameImages images;
  images.build_pyramid(image.view());
  return std::make_shared<const PlaceView>(describe_place(images.pyramid, images.all_corners()));
}

TEST_F(SessionTest, InLockstepAQueryIsAnsweredWithAPlaceInTheNewestRevision) {
  ASSERT_TRUE(session_->wait_for_server(60s));
  const auto image = scene_.render(testing::Scene::pose(1), 77);
  session_->send_query(view_of(*image), Timestamp{1});
  ASSERT_TRUE(session_->wait_until_settled(60s));
  auto answer = session_->take_relocalization_answer();
  ASSERT_TRUE(answer.has_value());
  EXPECT_EQ(answer->verdict, RelocalizationVerdict::kNotKnown) << "there is no map yet";
  EXPECT_FALSE(answer->reason.empty());

  seed();
  session_->send_query(view_of(*image), Timestamp{2});
  ASSERT_TRUE(session_->wait_until_settled(60s));
  answer = session_->take_relocalization_answer();
  ASSERT_TRUE(answer.has_value());
  ASSERT_EQ(answer->verdict, RelocalizationVerdict::kConfirmed) << answer->reason;
  const MapSnapshotPtr map = session_->snapshot();
  const PlaceCandidate& place = answer->candidates.front();
  EXPECT_EQ(place.map, map->map);
  EXPECT_EQ(place.epoch, map->epoch);
  EXPECT_EQ(place.revision, map->revision);
  EXPECT_NE(map->find(place.keyframe), nullptr);
  EXPECT_FALSE(session_->take_relocalization_answer()) << "once";

  const auto elsewhere = testing::Scene(12).render(testing::Scene::pose(1), 77);
  session_->send_query(view_of(*elsewhere), Timestamp{3});
  ASSERT_TRUE(session_->wait_until_settled(60s));
  answer = session_->take_relocalization_answer();
  ASSERT_TRUE(answer.has_value());
  EXPECT_EQ(answer->verdict, RelocalizationVerdict::kNotKnown);
}

TEST_F(SessionTest, AnAnswerFromBeforeTheMapWasLeftIsForgotten) {
  seed();
  const auto view = view_of(*scene_.render(testing::Scene::pose(1), 77));
  session_->send_query(view, Timestamp{1});
  ASSERT_TRUE(session_->wait_until_settled(60s));
  session_->leave_map();
  EXPECT_FALSE(session_->take_relocalization_answer()) << "had come";
  session_->send_query(view, Timestamp{2});
  session_->leave_map();
  EXPECT_TRUE(session_->wait_until_settled(60s));
  EXPECT_FALSE(session_->take_relocalization_answer()) << "was on its way";
  session_->send_query(view, Timestamp{3});
  ASSERT_TRUE(session_->wait_until_settled(60s));
  EXPECT_TRUE(session_->take_relocalization_answer()) << "the next query is answered";
}

TEST_F(SessionTest, SeveralClientsFollowOneMap) {
  seed();
  SessionOptions options = session_options_;
  options.name = "bob";
  auto bob = testing::open_session(options, scene_.camera());
  bob->use_map(session_->snapshot()->map);
  ASSERT_TRUE(eventually([&] { return bob->snapshot() != nullptr; }));
  expect_same_revision(*bob->snapshot(), *session_->snapshot());
  bob->leave_map();
  EXPECT_EQ(bob->snapshot(), nullptr);
  bob->use_map(session_->snapshot()->map);
  ASSERT_TRUE(eventually([&] { return bob->snapshot() != nullptr; })) << "also a second time";
}

}  // namespace
}  // namespace cairn
