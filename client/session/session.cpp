// SPDX-License-Identifier: Apache-2.0
#include "client/session/session.h"

#include <fmt/format.h>

#include <random>
#include <utility>

#include "client/session/connection.h"
#include "client/session/shared_core.h"
#include "common/geometry/camera_guess.h"
#include "common/wire/network_path.h"

namespace cairn {
namespace {

Result<wire::ParticipantOptions> joining(const SessionOptions& options, const Logger& log) {
  if (options.domain < 0 || options.domain > static_cast<int>(wire::kMaxDomain)) {
    return fail(ErrorCode::kUsage, "domain " + std::to_string(options.domain) + ": expected 0 to 230");
  }
  wire::ParticipantOptions participant;
  participant.domain = static_cast<uint32_t>(options.domain);
  participant.role = wire::Role::kClient;
  participant.server_host = options.server;
  participant.listen = options.listen;
  participant.profile = options.profile.empty() ? wire::default_profile(options.server) : options.profile;
  participant.loss_per_mille = options.xmit_loss_permille;
  participant.security = options.security;
  participant.log = log;
  return participant;
}

/// Different for every run and process.
SessionId random_session() {
  std::random_device device;
  const uint64_t high = device();
  return {(high << 32 | device()) | 1};
}

}  // namespace

std::string describe(const CameraUpdate& update) {
  const double k1 = update.camera->parameters().values.at(4);
  // How far a value may be off holds only where it is believed.
  if (!update.frozen)
    return fmt::format("focal length about {:.0f} px, k1 about {:.2f}", update.camera->focal_length(), k1);
  return fmt::format("focal length {:.1f} px +- {:.1f} %, k1 {:.3f} +- {:.3f}", update.camera->focal_length(),
                     100 * update.focal_sigma, k1, update.k1_sigma);
}

struct Session::State {
  State(SessionCore session, const Logger& log) : core(std::move(session), log) {}

  SharedCore core;
  std::unique_ptr<Connection> connection;
};

Result<std::unique_ptr<Session>> Session::open(const SessionOptions& options, const CameraPtr& camera,
                                               Logger log) {
  if (!is_valid_name(options.name)) {
    return fail(ErrorCode::kUsage, "name '" + options.name + "': expected 1 to 32 of a-z, 0-9 and -");
  }
  if (!options.wearer.empty() && !is_valid_name(options.wearer)) {
    return fail(ErrorCode::kUsage, "wearer '" + options.wearer + "': expected 1 to 32 of a-z, 0-9 and -");
  }
  if (!options.prior_sigma.empty() && options.prior_sigma.size() != kPriorValues)
    return fail(ErrorCode::kConfiguration,
                "a camera that is self-calibrated is pinhole-radtan with all its values");
  const auto participant = joining(options, log);
  if (!participant) return tl::unexpected(participant.error());
  auto state = std::make_unique<State>(SessionCore(options, camera, random_session), log);
  const auto encoding =
      participant->profile == "loopback" ? wire::ImageEncoding::kRaw : wire::ImageEncoding::kJpeg;
  const Connection::Network network{options.find_path ? options.find_path : wire::find_path,
                                    options.join ? options.join : wire::Participant::create};
  auto connection = Connection::open(state->core, *participant, encoding, network, std::move(log));
  if (!connection) return tl::unexpected(connection.error());
  state->connection = std::move(*connection);
  return std::unique_ptr<Session>(new Session(std::move(state)));
}

Session::Session(std::unique_ptr<State> state) : state_(std::move(state)) {}
Session::~Session() = default;

MapSnapshotPtr Session::snapshot() const {
  return state_->core.look([](const SessionCore& core) { return core.maps().snapshot(); });
}

void Session::use_map(MapId map, Epoch epoch, Revision revision) {
  state_->core.apply([&](SessionCore& core) { core.use_map(map, epoch, revision); });
  state_->connection->map_changed();
}

void Session::leave_map() {
  state_->core.apply([](SessionCore& core) { core.leave_map(); });
  state_->connection->map_changed();
}

KeyframeUse Session::keyframe_use(MapId map) const {
  return state_->core.look([&](const SessionCore& core) { return core.keyframe_use(map); });
}

void Session::send_seed(SeedProposal proposal) {
  state_->core.apply([&](SessionCore& core) { core.send_seed(std::move(proposal)); });
}

void Session::send_offer(KeyframeProposal proposal, GrayImagePtr image, Timestamp time) {
  SpooledOffer offer{std::move(proposal), std::move(image), time};
  state_->core.apply([&](SessionCore& core) { core.send_offer(std::move(offer)); });
}

void Session::send_query(std::shared_ptr<const PlaceView> view, Timestamp time) {
  state_->core.apply([&](SessionCore& core) { core.send_query(std::move(view), time); });
}

void Session::publish_state(const FrameResult& result, Timestamp time) {
  state_->core.apply([&](SessionCore& core) { core.publish_state(result, time); });
}

LabelListPtr Session::labels(MapId map) const {
  return state_->core.look([&](const SessionCore& core) { return core.maps().labels(map); });
}

void Session::send_request(wire::ClientRequest request) {
  state_->core.apply([&](SessionCore& core) { core.send_request(std::move(request)); });
}

std::vector<RequestReply> Session::take_request_replies() {
  return state_->core.apply([](SessionCore& core) { return core.take_request_replies(); });
}

std::optional<SeedReply> Session::take_seed_reply() {
  return state_->core.apply([](SessionCore& core) { return core.take_seed_reply(); });
}

std::vector<OfferReply> Session::take_offer_replies() {
  return state_->core.apply([](SessionCore& core) { return core.take_offer_replies(); });
}

std::optional<RelocalizationAnswer> Session::take_relocalization_answer() {
  return state_->core.apply([](SessionCore& core) { return core.take_relocalization_answer(); });
}

std::optional<CameraUpdate> Session::take_camera(const MapSnapshotPtr& snapshot) {
  return state_->core.apply([&](SessionCore& core) { return core.take_camera(snapshot); });
}

SessionStatus Session::status() const {
  SessionStatus status = state_->core.look([](const SessionCore& core) { return core.status(); });
  const wire::Traffic traffic = state_->connection->traffic();
  status.bytes_sent = traffic.bytes_sent;
  status.bytes_received = traffic.bytes_received;
  return status;
}

std::string Session::network() const {
  const std::string server = state_->core.look([](const SessionCore& core) { return core.options().server; });
  return wire::way_to(server, state_->connection->path());
}

bool Session::wait_for_server(std::chrono::milliseconds timeout) {
  return state_->core.wait(timeout,
                           [](const SessionCore& core) { return core.link() == ServerLink::kConnected; });
}

bool Session::wait_for_name(std::chrono::milliseconds timeout) {
  return state_->core.wait(timeout, [](const SessionCore& core) { return core.is_name_held(); });
}

bool Session::wait_for_map(std::chrono::milliseconds timeout) {
  return state_->core.wait(timeout,
                           [](const SessionCore& core) { return core.maps().snapshot() != nullptr; });
}

bool Session::wait_until_settled(std::chrono::milliseconds timeout) {
  // A refusal that is known already may end: a name becomes free.
  const std::string known_refusal = state_->core.look([](const SessionCore& core) { return core.refusal(); });
  const auto is_lost = [&](const SessionCore& core) {
    return core.link() == ServerLink::kGone || !core.is_map_known() ||
           (!core.refusal().empty() && core.refusal() != known_refusal);
  };
  const bool is_over =
      state_->core.wait(timeout, [&](const SessionCore& core) { return is_lost(core) || core.is_settled(); });
  return is_over &&
         state_->core.look([&](const SessionCore& core) { return !is_lost(core) && core.is_settled(); });
}

}  // namespace cairn
