// SPDX-License-Identifier: Apache-2.0
// Two cameras of one wearer: where the one is tracked narrows the answers to the other. Both map the same
// place, so that a query has two right answers.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <set>

#include "common/image/frame_images.h"
#include "common/image/place.h"
#include "common/wire/partition.h"
#include "common/wire/rig_messages.h"
#include "common/wire/topic.h"
#include "server/admin/admin_client.h"
#include "tests/integration/test_domain.h"
#include "tests/integration/two_views.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using testing::eventually;

class WearerTest : public ::testing::Test {
 protected:
  void start(WearerOptions options) {
    options_.wearers = std::move(options);
    service_ = testing::start_service(&options_);
    shoulder_ = open("shoulder", "anna");
    hand_ = open("hand", "anna");
  }
  std::unique_ptr<Session> open(const std::string& name, const std::string& wearer) {
    SessionOptions options;
    options.domain = options_.domain;
    options.name = name;
    options.wearer = wearer;
    options.lockstep = true;
    return testing::open_known_session(options, place_.camera());
  }
  MapId make_map(Session& session, const testing::Scene& scene) {
    session.send_seed(testing::make_seed(scene));
    EXPECT_TRUE(session.wait_until_settled(60s)) << session.status().text;
    const MapSnapshotPtr map = session.snapshot();
    EXPECT_NE(map, nullptr);
    session.leave_map();
    return map ? map->map : MapId{};
  }
  /// Makes the server hear that the shoulder camera is tracked, with a new image each time.
  void track_in(const MapId& map) {
    shoulder_->use_map(map);
    ASSERT_TRUE(shoulder_->wait_until_settled(60s));
    FrameResult result;
    result.state = TrackingState::kTracking;
    result.map = map;
    result.pose_measured = true;
    shoulder_->publish_state(result, Timestamp{++time_});
  }
  using View = std::shared_ptr<const PlaceView>;
  static View view_of(const testing::Scene& scene) {
    const auto image = scene.render(testing::Scene::pose(1), 77);
    FrameImages images;
    images.build_pyramid(image->view());
    return std::make_shared<const PlaceView>(describe_place(images.pyramid, images.all_corners()));
  }
  RelocalizationAnswer ask(const View& view) {
    hand_->send_query(view, Timestamp{++time_});
    EXPECT_TRUE(hand_->wait_until_settled(60s));
    return hand_->take_relocalization_answer().value_or(RelocalizationAnswer{});
  }
  /// The shoulder camera goes on being tracked in `map` until the hand camera is told what `accept` takes.
  bool told_while_tracked_in(const MapId& map, const View& view,
                             const std::function<bool(const RelocalizationAnswer&)>& accept) {
    return eventually([&] {
      track_in(map);
      return accept(ask(view));
    });
  }
  static std::set<MapId> maps_in(const RelocalizationAnswer& answer) {
    std::set<MapId> maps;
    for (const PlaceCandidate& candidate : answer.candidates) maps.insert(candidate.map);
    return maps;
  }
  static bool is_only(const RelocalizationAnswer& answer, const MapId& map) {
    return answer.verdict == RelocalizationVerdict::kConfirmed && maps_in(answer) == std::set{map};
  }

  const testing::Scene place_{11};
  const testing::Scene other_place_{12};
  // Made at once: a proof that the other camera is tracked is fresh for half a second.
  const View here_ = view_of(place_);
  const View elsewhere_ = view_of(other_place_);
  ServiceOptions options_;
  std::unique_ptr<Service> service_;
  std::unique_ptr<Session> shoulder_;
  std::unique_ptr<Session> hand_;
  int64_t time_ = 0;
};

TEST_F(WearerTest, OfTwoMapsOfOnePlaceTheOneIsAnsweredInWhichTheOtherCameraIs) {
  start({});
  const MapId one = make_map(*shoulder_, place_);
  const MapId two = make_map(*hand_, place_);
  ASSERT_NE(one, two);
  for (const MapId& map : {one, two, one}) {
    EXPECT_TRUE(told_while_tracked_in(map, here_, [&](const auto& said) { return is_only(said, map); }));
  }
}

/// The camera at the shoulder is on a rig of the same name, to which its tracker speaks too; the hand's is as
/// free as ever.
TEST_F(WearerTest, WithTheShoulderCameraOnARigTheRuleIsTheSameAndTheRigIsListed) {
  start({});
  wire::ParticipantOptions joining;
  joining.domain = options_.domain;
  joining.role = wire::Role::kRig;
  const auto rig = wire::Participant::create(joining).value();
  auto states = wire::Writer<wire::RigState>::create(rig, wire::rig_partition("shoulder")).value();
  auto poses = wire::Writer<wire::TrackerStateMessage>::create(
                   rig, wire::client_to_rig_partition("shoulder", "shoulder"))
                   .value();
  wire::RigState state;
  state.rig = "shoulder";
  state.mode = wire::RigMode::kSearch;
  state.commander = state.ordered_by = "shoulder";
  state.ordered = wire::RigMode::kSearch;
  state.order = {{7}, 1};
  wire::TrackerStateMessage lost;  // another process of that name, if it were heard
  lost.client = client_id_from_name("shoulder");
  lost.session = {9};
  lost.state = TrackingState::kLost;
  AdminClientOptions connection;
  connection.domain = static_cast<int>(options_.domain);
  auto admin = AdminClient::connect(connection).value();
  nlohmann::json rigs;
  ASSERT_TRUE(eventually([&] {
    (void)states.write(state);
    (void)poses.write(lost);
    rigs = admin.ask({{"verb", "rigs"}}).value().content["rigs"];
    return !rigs.empty();
  }));
  EXPECT_EQ(rigs[0]["rig"], "shoulder");
  EXPECT_EQ(rigs[0]["mode"], "search");
  EXPECT_EQ(rigs[0]["last_order"]["by"], "shoulder");
  const MapId one = make_map(*shoulder_, place_);
  const MapId two = make_map(*hand_, place_);
  for (const MapId& map : {one, two}) {
    EXPECT_TRUE(told_while_tracked_in(map, here_, [&](const auto& said) {
      (void)poses.write(lost);
      return is_only(said, map);
    }));
  }
}

TEST_F(WearerTest, AnotherPlaceIsFoundAllTheSame) {
  start({});
  const MapId here = make_map(*shoulder_, place_);
  const MapId there = make_map(*hand_, other_place_);
  EXPECT_TRUE(told_while_tracked_in(here, elsewhere_, [&](const auto& said) {
    return said.verdict == RelocalizationVerdict::kConfirmed && said.candidates.front().map == there;
  }));
}

TEST_F(WearerTest, ByThePapersRuleItIsNotUntilTheOtherCameraIsLost) {
  start({WearerPolicy::kOnly, {}});
  const MapId here = make_map(*shoulder_, place_);
  const MapId there = make_map(*hand_, other_place_);
  EXPECT_TRUE(told_while_tracked_in(here, elsewhere_, [&](const auto& said) {
    return said.verdict == RelocalizationVerdict::kNotThere && !maps_in(said).contains(there);
  }));
  EXPECT_TRUE(told_while_tracked_in(here, here_, [&](const auto& said) { return is_only(said, here); }));
  // The shoulder camera gives no new images.
  EXPECT_TRUE(eventually([&] { return is_only(ask(elsewhere_), there); }));
}

TEST_F(WearerTest, WhereTheOperatorHasRegisteredAClaimCountsForNothing) {
  start({WearerPolicy::kOnly, WearerList{{"shoulder", "anna"}}});
  const MapId here = make_map(*shoulder_, place_);
  const MapId there = make_map(*hand_, other_place_);
  for (int query = 0; query < 5; ++query) {
    track_in(here);
    const RelocalizationAnswer said = ask(elsewhere_);
    ASSERT_EQ(said.verdict, RelocalizationVerdict::kConfirmed);
    EXPECT_EQ(said.candidates.front().map, there);
  }
}

}  // namespace
}  // namespace cairn
