// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/io/test_directory.h"
#include "common/wire/internal/convert.h"
#include "server/service/simulation/server_run.h"
#include "server/service/simulation/views.h"

namespace cairn::simulation {

inline constexpr const char* kClient = "anna";
inline constexpr const char* kOperator = "olga";

/// The message as a peer has it: encoded and decoded.
template <typename Message>
[[nodiscard]] Result<Message> by_wire(const Message& message) {
  wire::internal::Scratch scratch;
  return wire::internal::decode<Message>(wire::internal::encode(message, &scratch));
}

template <typename Message>
void expect_taken(const Message& message) {
  const auto heard = by_wire(message);
  EXPECT_TRUE(heard.has_value()) << "who hears the server does not take it: " << heard.error().message;
}

/// A server with a map that `anna` has made.
class LoneClientFixture : public ::testing::Test {
 protected:
  void SetUp() override {
    begin();
    wire::MapSeed seed = views_.seed();
    seed.map_name = "desk";
    EXPECT_EQ(judge(seed), "");
    ASSERT_TRUE(verdict_ && verdict_->accepted);
    map_ = verdict_->map;
    server_->peers().want(kClient, map_);
    settle();
    ASSERT_TRUE(snapshot_);
  }

  /// Starts a server, and connects its client.
  void begin() {
    InProcess::Listener listener{[this](const std::string&, const Delivery& delivery) { hear(delivery); },
                                 [this](const std::string&, const wire::AdminReply& reply) {
                                   expect_taken(reply);
                                   reply_ = reply;
                                 },
                                 [](MapId, const MapSnapshotPtr&) {}};
    auto server = ServerRun::start({directory_.path(),
                                    clock_,
                                    &random_,
                                    std::chrono::seconds(0),
                                    std::move(listener),
                                    null_logger(),
                                    {},
                                    adjust_});
    ASSERT_TRUE(server) << server.error().message;
    server_ = std::move(*server);
    server_->peers().connect(kClient);
    speak();
    wire::CameraMessage camera;
    camera.client = id_;
    camera.parameters = views_.camera()->parameters();
    server_->service().sessions().announce(client_principal(kClient), process_, camera);
  }
  void begin_again() {
    server_->end();
    begin();
    settle();
  }

  /// Says that the client's process is there.
  void speak() {
    wire::TrackerStateMessage state;
    state.client = id_;
    state.session = session_;
    (void)server_->service().sessions().hear(client_principal(kClient), publication_, process_, state);
  }
  /// Lets two seconds pass, and does all that is to be done meanwhile.
  void settle() {
    for (int i = 0; i < 40; ++i) {
      clock_->advance(std::chrono::milliseconds(50));
      server_->tick_if_due();
      while (server_->run_something()) continue;
    }
  }
  void hear(const Delivery& delivery) {
    if (const auto* event = std::get_if<ClientEvent>(&delivery))
      return std::visit([this](const auto& e) { hear(e); }, *event);
    if (const auto* label = std::get_if<wire::LabelMessage>(&delivery)) return expect_taken(*label);
    const auto* snapshot = std::get_if<MapSnapshotPtr>(&delivery);
    if (snapshot == nullptr) return;
    snapshot_ = *snapshot;
    for (const auto& block : snapshot_->point_blocks) {
      expect_taken(wire::PointPatches{snapshot_->map, snapshot_->epoch, *block->patches});
      expect_taken(wire::PointPositions{snapshot_->map, snapshot_->epoch, *block->positions});
    }
    for (const auto& block : snapshot_->keyframe_blocks)
      expect_taken(wire::KeyframePoses{snapshot_->map, snapshot_->epoch, *block});
  }
  template <typename Event>
  void hear(const Event& event) {
    if constexpr (requires { typename wire::internal::DdsTypeOf<Event>::type; }) expect_taken(event);
    if constexpr (std::is_same_v<Event, wire::SeedVerdict>) verdict_ = event;
    if constexpr (std::is_same_v<Event, wire::OfferVerdict>) offers_ = event;
    if constexpr (std::is_same_v<Event, wire::ClientReply>) requests_ = event;
    if constexpr (std::is_same_v<Event, wire::RelocAnswer>) answer_ = event;
  }

  /// Sends a command once.
  template <typename Command>
  void send(Command* command) {
    command->client = id_;
    command->command = {session_, next_of(*command)++};
    speak();
    server_->service().take(client_principal(kClient), *command);
  }
  /// Sends a command until it is decided, as trackers do. Returns why it is refused, by whomever; else "".
  template <typename Command>
  std::string judge(Command command) {
    command.client = id_;
    if (command.command.seq == 0) command.command.seq = next_of(command);
    command.command.session = session_;
    const auto heard = by_wire(command);
    if (!heard) return heard.error().message;
    next_of(command) = command.command.seq + 1;
    for (int i = 0; i < 4; ++i) {
      speak();
      server_->service().take(client_principal(kClient), *heard);
      settle();
      if (const auto reason = reason_of(command)) return *reason;
    }
    return "nothing is said of it";
  }
  std::string ask(const std::string& request, std::vector<uint8_t> data = {}) {
    reply_.reset();
    const auto heard = by_wire(wire::AdminRequest{
        client_id_from_name(kOperator), {operator_session_, ++asked_}, request, std::move(data)});
    if (!heard) return heard.error().message;
    server_->service().take(operator_principal(kOperator, Principal::Proof::kClaimed, Duty::kAdminister),
                            *heard);
    settle();
    if (!reply_) return "nothing is said of it";
    return reply_->result == 0 ? "" : reply_->text;
  }

  uint64_t& next_of(const wire::MapSeed&) { return next_seed_; }
  uint64_t& next_of(const wire::KeyframeOffer&) { return next_offer_; }
  uint64_t& next_of(const wire::ClientRequest&) { return next_request_; }
  uint64_t& next_of(const wire::RelocQuery&) { return next_query_; }

  std::optional<std::string> reason_of(const wire::MapSeed& seed) const {
    if (!verdict_ || verdict_->command != seed.command) return std::nullopt;
    return verdict_->accepted ? "" : verdict_->reason;
  }
  template <typename Verdict>
  static std::optional<std::string> reason_in(const Verdict& verdict, uint64_t seq) {
    for (const auto& outcome : verdict.recent) {
      if (outcome.seq == seq) return outcome.decision == decltype(outcome.decision){} ? "" : outcome.reason;
    }
    return std::nullopt;
  }
  std::optional<std::string> reason_of(const wire::KeyframeOffer& offer) const {
    return reason_in(offers_, offer.command.seq);
  }
  std::optional<std::string> reason_of(const wire::ClientRequest& request) const {
    return reason_in(requests_, request.command.seq);
  }
  std::optional<std::string> reason_of(const wire::RelocQuery& query) const {
    if (!answer_ || answer_->command != query.command) return std::nullopt;
    return has_place(answer_->answer.verdict) ? "" : answer_->answer.reason;
  }

  [[nodiscard]] wire::KeyframeOffer sound_offer(int step) const {
    return views_.offer(*snapshot_, step).value();
  }

  const ClientId id_ = client_id_from_name(kClient);
  const SessionId session_{42};
  const wire::PeerId process_{{1, 2, 3}};
  const wire::PublicationHandle publication_{7};
  const Views& views_ = Views::of_place(0);
  const TestDirectory directory_;
  std::shared_ptr<FakeClock> clock_ = std::make_shared<FakeClock>();
  Random random_{1};
  SessionId operator_session_{42};  ///< a run of cairnctl
  std::function<void(MapServiceOptions& options)> adjust_;
  std::unique_ptr<ServerRun> server_;
  MapId map_;
  MapSnapshotPtr snapshot_;
  std::optional<wire::SeedVerdict> verdict_;
  wire::OfferVerdict offers_;
  wire::ClientReply requests_;
  std::optional<wire::RelocAnswer> answer_;
  std::optional<wire::AdminReply> reply_;
  uint64_t next_seed_ = 1;
  uint64_t next_offer_ = 1;
  uint64_t next_request_ = 1;
  uint64_t next_query_ = 1;
  uint64_t asked_ = 0;
};

}  // namespace cairn::simulation
