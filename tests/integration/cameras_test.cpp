// SPDX-License-Identifier: Apache-2.0
// A camera that the server's maps calibrate: the session against a server that writes what it is told to, and
// session and service together.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "common/geometry/camera_guess.h"
#include "common/io/test_directory.h"
#include "common/wire/partition.h"
#include "common/wire/topic.h"
#include "tests/integration/server_process.h"
#include "tests/integration/test_domain.h"
#include "tests/integration/two_views.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using testing::eventually;

constexpr const char* kName = "anna";
const MapId kMapA{{1}};
const MapId kMapB{{2}};

template <typename T>
T value_of(Result<T> result) {
  if (!result) throw std::runtime_error(result.error().message);
  return std::move(*result);
}

/// Focal length believed to 10 %, k1 to 0.05.
IntrinsicsPrior with_prior(const CameraPtr& camera, double focal_factor = 1) {
  IntrinsicsPrior result{camera->parameters(), 0.1, 0.05};
  result.parameters.values.resize(9, 0.0);
  for (const size_t i : {0, 1}) result.parameters.values[i] *= focal_factor;
  return result;
}

std::unique_ptr<Session> open_calibrating_session(SessionOptions options, const IntrinsicsPrior& camera) {
  options.prior_sigma = sigma_of_values(camera);
  return testing::open_session(options, value_of(make_camera(camera.parameters)));
}

/// A server without maps: it writes revisions and camera estimates that a test makes up.
class FakeServer {
 public:
  FakeServer()
      : participant_(join_free_domain(&domain_)),
        estimates_(value_of(wire::Writer<wire::CameraEstimate>::create(participant_, partition()))),
        cameras_(value_of(wire::Reader<wire::CameraMessage>::create(participant_, partition()))) {}

  [[nodiscard]] int domain() const { return domain_; }
  /// What the session says of its camera.
  [[nodiscard]] wire::CameraMessage announced() {
    for (auto& sample : cameras_.take()) {
      if (sample.message) announced_ = std::move(*sample.message);
    }
    return announced_;
  }
  /// Readies a map to be written, once the session wants it.
  void open(MapId map) {
    auto writer = wire::Writer<wire::MapCommit>::create(participant_, wire::map_partition(kName, map));
    const auto& commits = commits_.emplace(map, value_of(std::move(writer))).first->second;
    if (!eventually([&] { return commits.matched() > 0 && estimates_.matched() > 0; }))
      throw std::runtime_error("the session does not want the map");
  }
  /// A revision without points, made with these versions of cameras.
  void commit(MapId map, Epoch epoch, uint64_t revision, std::vector<CameraVersion> cameras) {
    wire::MapCommit message;
    message.map = map;
    message.name = "desk";
    message.epoch = epoch;
    message.revision = Revision{revision};
    message.cameras = std::move(cameras);
    if (!commits_.at(map).write(message)) throw std::runtime_error("not written");
  }
  void tell(MapId map, Epoch epoch, uint32_t version, double focal, bool frozen = false) {
    wire::CameraEstimate message;
    message.client = announced().client;
    message.camera = announced().camera;
    message.map = map;
    message.epoch = epoch;
    message.version = version;
    message.parameters = announced().parameters;
    for (const size_t i : {0, 1}) message.parameters.values[i] = focal;
    message.sigma = sigma_of_values({message.parameters, 0.02, 0.01});
    message.frozen = frozen;
    if (!estimates_.write(message)) throw std::runtime_error("not written");
  }

 private:
  static wire::Participant join_free_domain(int* domain) {
    wire::ParticipantOptions options;
    options.role = wire::Role::kServer;
    while (true) {
      *domain = testing::next_domain();
      options.domain = static_cast<uint32_t>(*domain);
      auto joined = wire::Participant::create(options);
      if (joined || joined.error().code != ErrorCode::kRefused) return value_of(std::move(joined));
    }
  }
  static std::string partition() { return wire::client_partition(kName); }

  int domain_ = 0;
  wire::Participant participant_;
  wire::Writer<wire::CameraEstimate> estimates_;
  wire::Reader<wire::CameraMessage> cameras_;
  std::map<MapId, wire::Writer<wire::MapCommit>> commits_;
  wire::CameraMessage announced_;
};

/// A session whose camera is calibrated, with two maps open.
class CameraSession : public ::testing::Test {
 protected:
  static constexpr Epoch kEpoch{1};

  CameraSession() {
    SessionOptions options;
    options.domain = server_.domain();
    options.name = kName;
    session_ = open_calibrating_session(options, with_prior(testing::test_camera()));
    if (!eventually([&] { return server_.announced().client == client_id_from_name(kName); }))
      throw std::runtime_error("no camera is announced");
    for (const MapId map : {kMapB, kMapA}) {
      session_->use_map(map);
      server_.open(map);
    }
  }

  /// Of the session's camera.
  [[nodiscard]] CameraVersion version(uint32_t number) {
    return {server_.announced().client, server_.announced().camera, number};
  }
  [[nodiscard]] bool comes_to(MapId map, uint64_t revision, Epoch epoch = kEpoch) {
    session_->use_map(map);
    return eventually([&] {
      const MapSnapshotPtr now = session_->snapshot();
      return now && now->map == map && now->epoch == epoch && now->revision.value >= revision;
    });
  }
  /// After everything that was written before has been looked at.
  void expect_still_waiting_for(MapId map, uint64_t revision) {
    const MapId other = map == kMapA ? kMapB : kMapA;
    server_.commit(other, kEpoch, ++marker_, {});
    ASSERT_TRUE(comes_to(other, marker_));
    session_->use_map(map);
    const MapSnapshotPtr now = session_->snapshot();
    EXPECT_FALSE(now->map == map && now->revision.value >= revision) << "without the values it was made with";
  }
  /// Focal length of the values that are to be used from now on; 0: those in use stay.
  [[nodiscard]] double taken_focal() {
    const auto update = session_->take_camera(session_->snapshot());
    return update ? update->camera->focal_length() : 0;
  }

  uint64_t marker_ = 100;
  FakeServer server_;
  std::unique_ptr<Session> session_;
};

TEST_F(CameraSession, ARevisionWaitsForTheValuesItWasMadeWith) {
  server_.commit(kMapA, kEpoch, 1, {version(2)});
  expect_still_waiting_for(kMapA, 1);
  server_.tell(kMapA, kEpoch, 1, 300);
  expect_still_waiting_for(kMapA, 1);
  server_.tell(kMapA, kEpoch, 2, 310);
  ASSERT_TRUE(comes_to(kMapA, 1));
  EXPECT_EQ(taken_focal(), 310);
  EXPECT_EQ(taken_focal(), 0) << "once";
}

TEST_F(CameraSession, LaterValuesDoWhereThoseNamedWereLost) {
  server_.tell(kMapA, kEpoch, 4, 320);  // 3 was overtaken: the middleware keeps the last
  server_.commit(kMapA, kEpoch, 1, {version(3)});
  ASSERT_TRUE(comes_to(kMapA, 1));
  EXPECT_EQ(taken_focal(), 320);
  server_.commit(kMapA, kEpoch, 2, {version(4)});
  ASSERT_TRUE(comes_to(kMapA, 2));
  EXPECT_EQ(taken_focal(), 0) << "they are in use";
}

TEST_F(CameraSession, ValuesThatOvertookTheirRevisionWaitForTheirs) {
  // The middleware keeps the last of each map, so 2 must have been taken before 3 is written: estimates do
  // arrive once a revision that waits for one is there, and the turn in which 2 came has ended when a
  // revision written after its is.
  server_.tell(kMapB, kEpoch, 1, 300);
  server_.commit(kMapB, kEpoch, 1, {version(1)});
  ASSERT_TRUE(comes_to(kMapB, 1));
  server_.tell(kMapA, kEpoch, 2, 310);
  for (const uint64_t revision : {2, 3}) {
    server_.commit(kMapB, kEpoch, revision, {});
    ASSERT_TRUE(comes_to(kMapB, revision));
  }
  server_.tell(kMapA, kEpoch, 3, 320);
  server_.commit(kMapA, kEpoch, 1, {version(2)});
  ASSERT_TRUE(comes_to(kMapA, 1));
  EXPECT_EQ(taken_focal(), 310);
  server_.commit(kMapA, kEpoch, 2, {version(3)});
  ASSERT_TRUE(comes_to(kMapA, 2));
  EXPECT_EQ(taken_focal(), 320);
}

TEST_F(CameraSession, WhatAMapMerelyBelievesIsNotHandedOn) {
  const CameraParameters first = server_.announced().parameters;
  server_.tell(kMapA, kEpoch, 2, 310);
  server_.commit(kMapA, kEpoch, 1, {version(2)});
  ASSERT_TRUE(comes_to(kMapA, 1));
  EXPECT_EQ(taken_focal(), 310);
  session_->leave_map();
  const auto again = session_->take_camera(nullptr);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->camera->parameters(), first);
  EXPECT_FALSE(session_->take_camera(nullptr)) << "once";
  ASSERT_TRUE(eventually([&] { return server_.announced().version == 3; }));
  EXPECT_EQ(server_.announced().parameters, first);
  ASSERT_TRUE(comes_to(kMapA, 1));
  EXPECT_EQ(taken_focal(), 310) << "in that map they hold";
}

TEST_F(CameraSession, EachMapCountsItsOwnVersions) {
  server_.tell(kMapA, kEpoch, 7, 300);
  server_.commit(kMapA, kEpoch, 1, {version(7)});
  ASSERT_TRUE(comes_to(kMapA, 1));
  EXPECT_EQ(taken_focal(), 300);
  server_.commit(kMapB, kEpoch, 1, {version(2)});
  session_->use_map(kMapB);
  server_.commit(kMapA, kEpoch, 2, {version(7)});
  ASSERT_TRUE(comes_to(kMapA, 2));
  session_->use_map(kMapB);
  EXPECT_EQ(session_->snapshot()->map, kMapA) << "version 7 of A is not version 2 of B";
  server_.tell(kMapB, kEpoch, 2, 350);
  ASSERT_TRUE(comes_to(kMapB, 1));
  EXPECT_EQ(taken_focal(), 350);
  ASSERT_TRUE(comes_to(kMapA, 2));
  EXPECT_EQ(taken_focal(), 300);
  ASSERT_TRUE(eventually([&] { return server_.announced().version == 4; })) << "one for each change";
  EXPECT_EQ(server_.announced().parameters.values[0], 300);
}

TEST_F(CameraSession, WhatIsKnownStaysAndIsSaid) {
  server_.tell(kMapA, kEpoch, 3, 300, true);
  server_.commit(kMapA, kEpoch, 1, {version(3)});
  ASSERT_TRUE(comes_to(kMapA, 1));
  EXPECT_EQ(taken_focal(), 300);
  ASSERT_TRUE(eventually([&] { return server_.announced().frozen; }));
  EXPECT_EQ(server_.announced().parameters.values[0], 300);
  server_.tell(kMapB, kEpoch, 9, 400);
  server_.commit(kMapB, kEpoch, 1, {version(9)});
  ASSERT_TRUE(comes_to(kMapB, 1));
  EXPECT_EQ(taken_focal(), 0) << "another map knows it worse";
  server_.commit(kMapB, kEpoch, 2, {version(11)});
  ASSERT_TRUE(comes_to(kMapB, 2)) << "nothing is waited for any more";
}

TEST_F(CameraSession, AGuessOfAYoungMapIsNoKnowledgeForTheNext) {
  const auto relative_sigma = [this] {
    return server_.announced().sigma[0] / server_.announced().parameters.values[0];
  };
  const double first = relative_sigma();
  server_.tell(kMapA, kEpoch, 3, 300);
  server_.commit(kMapA, kEpoch, 1, {version(3)});
  ASSERT_TRUE(comes_to(kMapA, 1));
  EXPECT_EQ(taken_focal(), 300);
  ASSERT_TRUE(eventually([&] { return server_.announced().parameters.values[0] == 300; }));
  EXPECT_DOUBLE_EQ(relative_sigma(), first);
  EXPECT_DOUBLE_EQ(server_.announced().sigma[4], 0.05);
  server_.tell(kMapA, kEpoch, 4, 305, true);
  server_.commit(kMapA, kEpoch, 2, {version(4)});
  ASSERT_TRUE(comes_to(kMapA, 2));
  EXPECT_EQ(taken_focal(), 305);
  ASSERT_TRUE(eventually([&] { return server_.announced().frozen; }));
  EXPECT_DOUBLE_EQ(relative_sigma(), 0.02);
}

TEST_F(CameraSession, AnotherEpochCountsAnew) {
  server_.tell(kMapA, kEpoch, 8, 300);
  server_.commit(kMapA, kEpoch, 5, {version(8)});
  ASSERT_TRUE(comes_to(kMapA, 5));
  EXPECT_EQ(taken_focal(), 300);
  // The successor of a server that has died has what was saved: fewer versions.
  const Epoch next{kEpoch.value + 1};
  server_.tell(kMapA, next, 6, 310);
  server_.commit(kMapA, next, 1, {version(6)});
  ASSERT_TRUE(comes_to(kMapA, 1, next));
  EXPECT_EQ(taken_focal(), 310);
  server_.tell(kMapA, kEpoch, 9, 305);
  server_.commit(kMapA, next, 2, {version(6)});
  ASSERT_TRUE(comes_to(kMapA, 2, next));
  EXPECT_EQ(taken_focal(), 0) << "a late word of the dead server";
}

TEST_F(CameraSession, OnlyWhatIsNamedOfItsOwnIsWaitedFor) {
  CameraVersion someone_else = version(1);
  someone_else.client = client_id_from_name("bob");
  CameraVersion other_images = version(1);
  ++other_images.camera;
  server_.commit(kMapA, kEpoch, 1, {someone_else, other_images});
  ASSERT_TRUE(comes_to(kMapA, 1));
  EXPECT_EQ(taken_focal(), 0);
}

TEST_F(CameraSession, ValuesThatCannotBeAreNotUsed) {
  for (const double focal : {1e-3, 1e9}) server_.tell(kMapA, kEpoch, 2, focal);
  server_.commit(kMapA, kEpoch, 1, {version(1)});
  expect_still_waiting_for(kMapA, 1);
  server_.tell(kMapA, kEpoch, 3, 310);
  ASSERT_TRUE(comes_to(kMapA, 1));
  EXPECT_EQ(taken_focal(), 310);
}

/// Session and service. The scene's camera is believed to be 2 % longer than it is.
class SelfCalibration : public ::testing::Test {
 protected:
  static constexpr double kBelieved = 1.02;

  SelfCalibration() : service_(testing::start_service(&service_options_)) {
    options_.domain = service_options_.domain;
    options_.name = kName;
    options_.lockstep = true;
  }

  [[nodiscard]] std::unique_ptr<Session> open_calibrating() const {
    return open_calibrating_session(options_, with_prior(scene_.camera(), kBelieved));
  }
  [[nodiscard]] std::unique_ptr<Session> open_exact() const {
    return testing::open_session(options_, scene_.camera());
  }
  void seed(Session& session) const {
    ASSERT_TRUE(session.wait_for_server(60s));
    session.send_seed(testing::make_seed(scene_));
    ASSERT_TRUE(session.wait_until_settled(60s)) << session.status().text;
    const auto reply = session.take_seed_reply();
    ASSERT_TRUE(reply && reply->answer) << (reply ? reply->reason : "no reply");
  }
  [[nodiscard]] OfferReply offer(Session& session, int step) const {
    testing::Frame frame = testing::make_offer(scene_, *session.snapshot(), step);
    session.send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{step});
    EXPECT_TRUE(session.wait_until_settled(60s));
    const auto replies = session.take_offer_replies();
    return replies.size() == 1 ? replies.front() : OfferReply{};
  }
  [[nodiscard]] static std::optional<CameraUpdate> take_camera(Session& session) {
    const MapSnapshotPtr map = session.snapshot();
    return map ? session.take_camera(map) : std::nullopt;
  }
  [[nodiscard]] static bool gets(Session& session, MapId map) {
    session.use_map(map);
    return eventually([&] { return session.snapshot() && session.snapshot()->map == map; });
  }
  [[nodiscard]] MapSnapshotPtr map_at_server() const { return service_->maps().at(0); }

  testing::Scene scene_{11};
  ServiceOptions service_options_;
  std::unique_ptr<Service> service_;
  SessionOptions options_;
};

TEST_F(SelfCalibration, IsAdjustedWithTheMapAndToldWithItsRevisions) {
  const auto session = open_calibrating();
  seed(*session);
  const auto first = take_camera(*session);
  ASSERT_TRUE(first);
  EXPECT_EQ(first->version, 1U);
  EXPECT_NEAR(first->camera->focal_length(), kBelieved * scene_.camera()->focal_length(), 1e-6);
  for (const int step : {5, 8, 11}) {
    const OfferReply reply = offer(*session, step);
    EXPECT_TRUE(reply.accepted) << reply.reason;
  }
  const auto later = take_camera(*session);
  ASSERT_TRUE(later);
  EXPECT_GT(later->version, 1U);
  EXPECT_NE(later->camera->focal_length(), first->camera->focal_length());
  ASSERT_EQ(session->snapshot()->cameras.size(), 1U);
  EXPECT_EQ(session->snapshot()->cameras[0].version, later->version);
  EXPECT_EQ(map_at_server()->cameras, session->snapshot()->cameras);
}

TEST_F(SelfCalibration, TheSameNameWithAnExactCameraGetsItsMapAndGrowsIt) {
  auto session = open_calibrating();
  seed(*session);
  EXPECT_TRUE(offer(*session, 5).accepted);
  const MapId map = session->snapshot()->map;
  session.reset();
  session = open_exact();
  ASSERT_TRUE(gets(*session, map));
  EXPECT_FALSE(take_camera(*session)) << "its values are exact";
  const OfferReply reply = offer(*session, 8);
  EXPECT_TRUE(reply.accepted) << reply.reason;
  EXPECT_EQ(map_at_server()->cameras.size(), 1U) << "an exact camera is not calibrated";
}

TEST_F(SelfCalibration, AnotherSizeOfImageIsAnotherCamera) {
  auto session = open_calibrating();
  seed(*session);
  const MapId map = session->snapshot()->map;
  session.reset();
  const IntrinsicsPrior small = guess_camera({200, 150});
  session = open_calibrating_session(options_, small);
  ASSERT_TRUE(gets(*session, map)) << "it waits for nothing";
  EXPECT_FALSE(take_camera(*session));
}

TEST_F(SelfCalibration, WhoComesBackIsToldAgain) {
  auto session = open_calibrating();
  seed(*session);
  for (const int step : {5, 8}) EXPECT_TRUE(offer(*session, step).accepted);
  const auto told = take_camera(*session);
  ASSERT_TRUE(told);
  const MapId map = session->snapshot()->map;
  session.reset();
  session = open_calibrating();
  ASSERT_TRUE(gets(*session, map));
  const auto again = take_camera(*session);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->version, told->version);
  EXPECT_EQ(again->camera->parameters(), told->camera->parameters());
}

TEST_F(SelfCalibration, ARefusedKeyframeLeavesNothingToCalibrate) {
  const auto builder = open_exact();
  seed(*builder);
  options_.name = "bob";
  const auto bob = open_calibrating();
  ASSERT_TRUE(gets(*bob, builder->snapshot()->map));
  EXPECT_FALSE(offer(*bob, testing::kSecondView).accepted) << "a keyframe stands there already";
  EXPECT_TRUE(offer(*builder, 5).accepted);
  EXPECT_TRUE(map_at_server()->cameras.empty());
  const OfferReply reply = offer(*bob, 8);
  EXPECT_TRUE(reply.accepted) << reply.reason;
  EXPECT_EQ(map_at_server()->cameras.size(), 1U);
}

TEST_F(SelfCalibration, AbsurdCamerasDoTheServerNoHarm) {
  const double focal = scene_.camera()->focal_length();
  for (const auto& [factor, sigma] : {std::pair(1e-300, 0.35), std::pair(1e300, 0.35), std::pair(1.0, 1e3)}) {
    IntrinsicsPrior absurd = with_prior(scene_.camera());
    for (const size_t i : {0, 1}) absurd.parameters.values[i] = factor * focal;
    absurd.focal_sigma = absurd.k1_sigma = sigma;
    const auto session = open_calibrating_session(options_, absurd);
    ASSERT_TRUE(session->wait_for_server(60s));
    session->send_seed(testing::make_seed(scene_));
    ASSERT_TRUE(session->wait_until_settled(60s)) << session->status().text;
    const auto reply = session->take_seed_reply();
    EXPECT_TRUE(reply && !reply->answer) << factor << ", " << sigma;
  }
  const auto session = open_calibrating();
  seed(*session);
}

/// The cairn-server program with a store.
class KeptCamera : public ::testing::Test {
 protected:
  [[nodiscard]] std::vector<std::string> arguments() const { return {"--store", folder_.path().string()}; }
  const testing::Scene scene_{11};
  const TestDirectory folder_;
};

TEST_F(KeptCamera, ASuccessorGoesOnFindingItOut) {
  auto server = std::make_unique<testing::ServerProcess>(0, arguments());
  SessionOptions options;
  options.domain = server->domain();
  options.name = kName;
  options.lockstep = true;
  const auto session = open_calibrating_session(options, with_prior(scene_.camera(), 1.02));
  ASSERT_TRUE(session->wait_for_server(60s));
  session->send_seed(testing::make_seed(scene_));
  ASSERT_TRUE(session->wait_until_settled(60s)) << session->status().text;
  ASSERT_TRUE(session->take_camera(session->snapshot()));
  const Epoch before = session->snapshot()->epoch;
  server->end(SIGKILL);
  server = std::make_unique<testing::ServerProcess>(options.domain, arguments());
  ASSERT_TRUE(eventually([&] { return session->snapshot()->epoch > before; })) << "its values have come, too";
  EXPECT_TRUE(session->take_camera(session->snapshot())) << "counted in the new epoch";
  ASSERT_EQ(session->snapshot()->cameras.size(), 1U);
}

}  // namespace
}  // namespace cairn
