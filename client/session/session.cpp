// SPDX-License-Identifier: Apache-2.0
#include "client/session/session.h"

#include <fmt/format.h>

#include <utility>

#include "client/session/connection.h"
#include "client/session/session_state.h"
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

/// A camera that is found out is known to the maps by the client's name and this number. Pictures of another
/// size come from another camera.
uint32_t number_by_size(const Camera& camera) {
  return static_cast<uint32_t>(camera.width()) << 16 | static_cast<uint32_t>(camera.height());
}

}  // namespace

std::string describe(const CameraNews& news) {
  const double k1 = news.camera->parameters().values.at(4);
  // How far a value may be off holds only where it is believed.
  if (!news.frozen)
    return fmt::format("focal length about {:.0f} px, k1 about {:.2f}", news.camera->focal_length(), k1);
  return fmt::format("focal length {:.1f} px +- {:.1f} %, k1 {:.3f} +- {:.3f}", news.camera->focal_length(),
                     100 * news.focal_sigma, k1, news.k1_sigma);
}

struct Session::State {
  explicit State(const SessionOptions& options)
      : shared(options, client_id_from_name(options.name), random_session()) {}

  SessionState shared;
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
  if (!options.camera_sigma.empty() && options.camera_sigma.size() != kDoubtfulValues)
    return fail(ErrorCode::kConfiguration,
                "a camera that is found out is pinhole-radtan with all its values");
  const auto participant = joining(options, log);
  if (!participant) return tl::unexpected(participant.error());
  auto state = std::make_unique<State>(options);
  wire::CameraMessage& announced = state->shared.camera;
  announced.parameters = camera->parameters();
  if (!options.camera_sigma.empty()) {
    announced.camera = number_by_size(*camera);
    state->shared.first_focal_sigma = options.camera_sigma.at(0) / announced.parameters.values.at(0);
    state->shared.first_k1_sigma = options.camera_sigma.at(4);
    state->shared.first_camera = camera;
  }
  announced.sigma = options.camera_sigma;
  announced.frozen = options.camera_sigma.empty();
  const auto encoding =
      participant->profile == "loopback" ? wire::ImageEncoding::kRaw : wire::ImageEncoding::kJpeg;
  auto connection = Connection::open(state->shared, *participant, encoding,
                                     options.find_path ? options.find_path : wire::find_path, std::move(log));
  if (!connection) return tl::unexpected(connection.error());
  state->connection = std::move(*connection);
  return std::unique_ptr<Session>(new Session(std::move(state)));
}

Session::Session(std::unique_ptr<State> state) : state_(std::move(state)) {}
Session::~Session() = default;

MapSnapshotPtr Session::snapshot() const {
  const std::scoped_lock lock(state_->shared.mutex);
  return state_->shared.snapshot;
}

void Session::use_map(MapId map, Epoch epoch, Revision revision) {
  {
    const std::scoped_lock lock(state_->shared.mutex);
    state_->shared.choose_map(map);
    if (map) state_->shared.require({map, epoch, revision});
    state_->shared.tracker_changed = true;
  }
  state_->connection->map_changed();
}

void Session::leave_map() {
  {
    const std::scoped_lock lock(state_->shared.mutex);
    state_->shared.seed.drop();
    state_->shared.seed_reply.reset();
    state_->shared.question.drop();
    state_->shared.place_answer.reset();
  }
  use_map({});
}

KeyframeUse Session::keyframe_use(MapId map) const {
  const std::scoped_lock lock(state_->shared.mutex);
  return state_->shared.use_of_keyframes(map);
}

void Session::send_seed(SeedProposal proposal) {
  const std::scoped_lock lock(state_->shared.mutex);
  state_->shared.seed.put(std::move(proposal));
  state_->shared.for_sender.notify_one();
}

void Session::send_offer(KeyframeProposal proposal, GrayImagePtr image, Timestamp time) {
  SessionState& shared = state_->shared;
  const std::scoped_lock lock(shared.mutex);
  if (!shared.is_map_known()) {
    shared.offer_replies.push_back({0, false, kRestartedText, {}, time, proposal.number});
    return;
  }
  auto lost = shared.spool.push({std::move(proposal), std::move(image), time});
  if (lost) shared.offer_replies.push_back(std::move(*lost));
  shared.for_sender.notify_one();
}

void Session::send_question(std::shared_ptr<const PlaceView> view, Timestamp time) {
  SessionState& shared = state_->shared;
  const std::scoped_lock lock(shared.mutex);
  if (shared.monitor.link() != ServerLink::kConnected) return;
  shared.place_answer.reset();  // of an older question
  shared.question.put({std::move(view), shared.map_in_use, time});
  shared.for_sender.notify_one();
}

void Session::publish_state(const FrameResult& result, Timestamp time) {
  SessionState& shared = state_->shared;
  const std::scoped_lock lock(shared.mutex);
  shared.tracker.state = result.state;
  shared.tracker.map = result.map;
  shared.tracker.camera_from_map = result.camera_from_map;
  shared.tracker.quality = result.quality;
  shared.tracker.frame_time = time;
  shared.tracker_changed = true;
  shared.for_sender.notify_one();
}

LabelListPtr Session::labels(MapId map) const {
  const SessionState& shared = state_->shared;
  const std::scoped_lock lock(shared.mutex);
  const auto labels = shared.labels.find(map);
  return labels == shared.labels.end() ? nullptr : labels->second;
}

void Session::send_request(wire::ClientRequest request) {
  SessionState& shared = state_->shared;
  const std::scoped_lock lock(shared.mutex);
  if (shared.options.reads_only || !shared.is_map_known()) {
    const char* why = shared.options.reads_only ? "a reader changes no labels" : kRestartedText;
    shared.request_replies.push_back(RequestTopic::reply({}, 0, false, why));
    return;
  }
  auto lost = shared.requests.push(std::move(request));
  if (lost) shared.request_replies.push_back(std::move(*lost));
  shared.for_sender.notify_one();
}

std::vector<RequestReply> Session::take_request_replies() {
  const std::scoped_lock lock(state_->shared.mutex);
  return std::exchange(state_->shared.request_replies, {});
}

std::optional<SeedReply> Session::take_seed_reply() {
  const std::scoped_lock lock(state_->shared.mutex);
  return std::exchange(state_->shared.seed_reply, std::nullopt);
}

std::vector<OfferReply> Session::take_offer_replies() {
  const std::scoped_lock lock(state_->shared.mutex);
  return std::exchange(state_->shared.offer_replies, {});
}

std::optional<PlaceAnswer> Session::take_place_answer() {
  const std::scoped_lock lock(state_->shared.mutex);
  return std::exchange(state_->shared.place_answer, std::nullopt);
}

std::optional<CameraNews> Session::take_camera(const MapSnapshotPtr& snapshot) {
  SessionState& shared = state_->shared;
  const std::scoped_lock lock(shared.mutex);
  if (snapshot == nullptr) {
    const bool keeps = !shared.camera_source || shared.camera.frozen || shared.map_in_use;
    if (keeps) return std::nullopt;
    return shared.use_camera(std::nullopt, shared.first_guess());
  }
  const auto other = shared.other_camera_of(*snapshot);
  const SessionState::FoundCamera* there = other ? shared.find_camera(*other) : nullptr;
  if (there == nullptr) return std::nullopt;
  const SessionState::CameraSource source{snapshot->map, there->epoch, there->news.version};
  if (source == shared.camera_source) return std::nullopt;
  return shared.use_camera(source, there->news);
}

SessionStatus Session::status() const {
  const SessionState& shared = state_->shared;
  const wire::Traffic traffic = state_->connection->traffic();
  const std::scoped_lock lock(shared.mutex);
  SessionStatus status;
  status.link = shared.monitor.link();
  status.map_known = shared.is_map_known();
  status.spooled = shared.spool.size();
  status.bytes_sent = traffic.bytes_sent;
  status.bytes_received = traffic.bytes_received;
  if (status.link == ServerLink::kConnecting) {
    status.text = "waiting for a server at " + shared.options.server;
  } else if (status.link == ServerLink::kGone) {
    const bool lost = shared.tracker.state == TrackingState::kLost;
    status.text = !shared.snapshot ? "server gone"
                  : lost ? "server gone: lost; searching from where it was last, no more can be done"
                         : "server gone: tracking on the replica";
  } else if (!shared.refusal.empty()) {
    status.link = ServerLink::kRefused;
    status.text = shared.refusal;
  } else if (!status.map_known) {
    status.link = ServerLink::kRestarted;
    status.text = std::string(kRestartedText) + ": it begins a new one when lost, or asked to";
  } else if (shared.unsound_cameras.contains(shared.map_in_use)) {
    status.text = "what the map says of the camera cannot be: it is not tracked on";
  } else {
    status.text = "connected to " + shared.options.server;
  }
  return status;
}

std::string Session::network() const {
  return wire::way_to(state_->shared.options.server, state_->connection->path());
}

bool Session::wait_for_server(std::chrono::milliseconds timeout) {
  SessionState& shared = state_->shared;
  std::unique_lock lock(shared.mutex);
  return shared.for_waiters.wait_for(lock, timeout,
                                     [&] { return shared.monitor.link() == ServerLink::kConnected; });
}

bool Session::wait_for_name(std::chrono::milliseconds timeout) {
  SessionState& shared = state_->shared;
  std::unique_lock lock(shared.mutex);
  return shared.for_waiters.wait_for(lock, timeout, [&] { return shared.name_held; });
}

bool Session::wait_for_map(std::chrono::milliseconds timeout) {
  SessionState& shared = state_->shared;
  std::unique_lock lock(shared.mutex);
  return shared.for_waiters.wait_for(lock, timeout, [&] { return shared.snapshot != nullptr; });
}

bool Session::wait_until_settled(std::chrono::milliseconds timeout) {
  SessionState& shared = state_->shared;
  std::unique_lock lock(shared.mutex);
  // A refusal that is known already may end: a name becomes free.
  const std::string known_refusal = shared.refusal;
  const auto is_lost = [&] {
    return shared.monitor.link() == ServerLink::kGone || !shared.is_map_known() ||
           (!shared.refusal.empty() && shared.refusal != known_refusal);
  };
  const auto is_settled = [&] {
    return shared.seed.empty() && shared.spool.size() == 0 && shared.question.empty() &&
           shared.requests.size() == 0 && shared.is_current();
  };
  shared.for_waiters.wait_for(lock, timeout, [&] { return is_lost() || is_settled(); });
  return !is_lost() && is_settled();
}

}  // namespace cairn
