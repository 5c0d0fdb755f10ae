// SPDX-License-Identifier: Apache-2.0
#include "client/session/sender.h"

#include <utility>

#include "client/session/image_encoder.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kLeastStateInterval{16};
constexpr milliseconds kMostStateInterval{
    200};  // keeps the name held (server: 3 s of silence) and the replica's progress known

}  // namespace

Result<std::unique_ptr<Sender>> Sender::start(SessionState& state, const wire::Participant& participant,
                                              const std::string& partition, wire::ImageEncoding encoding,
                                              Logger log) {
  auto writers = wire::create_all<wire::Writer<wire::CameraMessage>, wire::Writer<wire::TrackerStateMessage>,
                                  wire::Writer<wire::MapSeed>, wire::Writer<wire::KeyframeOffer>,
                                  wire::Writer<wire::RelocQuery>, wire::Writer<wire::ClientRequest>>(
      participant, partition);
  if (!writers) return tl::unexpected(writers.error());
  auto& [cameras, tracker, seeds, offers, questions, requests] = *writers;
  return std::unique_ptr<Sender>(new Sender(state,
                                            {std::move(cameras), std::move(tracker), std::move(seeds),
                                             std::move(offers), std::move(questions), std::move(requests)},
                                            encoding, std::move(log)));
}

Sender::Sender(SessionState& state, Writers writers, wire::ImageEncoding encoding, Logger log)
    : state_(state), writers_(std::move(writers)), encoding_(encoding), log_(std::move(log)), thread_([this] {
        run();
      }) {}

Sender::~Sender() {
  thread_.join();
}

void Sender::run() {
  std::unique_lock lock(state_.mutex);
  while (!state_.stopping) {
    const MonotonicTime now = std::chrono::steady_clock::now();
    try {
      send_camera(lock);
      send_tracker_state(lock, now);
      send_commands(lock, now);
    } catch (const std::exception& error) {  // what can not be sent must not end the tracker
      if (warning_.due()) log_->error("sending failed: {}", error.what());
      if (!lock.owns_lock()) lock.lock();
    }
    if (state_.stopping) return;
    // A change that came while the mutex was free for writing is seen within the least interval.
    const auto wait = state_.tracker_changed ? kLeastStateInterval : kMostStateInterval;
    state_.for_sender.wait_until(lock, state_sent_ + wait);
  }
}

/// Before any command that names it.
void Sender::send_camera(std::unique_lock<std::mutex>& lock) {
  if (!state_.camera_due) return;
  state_.camera_due = false;
  wire::CameraMessage message = state_.camera;
  lock.unlock();
  const Status written = writers_.camera.write(message);
  report(written, "Camera");
  if (written) camera_ = std::move(message);
  lock.lock();
  if (!written) state_.camera_due = true;  // tried again with the next round
}

void Sender::send_tracker_state(std::unique_lock<std::mutex>& lock, MonotonicTime now) {
  const auto interval = state_.tracker_changed ? kLeastStateInterval : kMostStateInterval;
  if (now - state_sent_ < interval) return;
  state_sent_ = now;
  state_.tracker_changed = false;
  wire::TrackerStateMessage message = state_.tracker;
  message.session = state_.session_id;
  // The pose of the frame may be in the map that was in use before.
  const MapSnapshotPtr replica = state_.replica_in_use();
  if (message.map != state_.map_in_use && message.state != TrackingState::kStarting) {
    message.state = TrackingState::kLost;
  }
  message.map = state_.map_in_use;
  message.epoch = replica ? replica->epoch : Epoch{};
  message.revision = replica ? replica->revision : Revision{};
  lock.unlock();
  report(writers_.tracker.write(message), "TrackerState");
  lock.lock();
}

void Sender::send_commands(std::unique_lock<std::mutex>& lock, MonotonicTime now) {
  while (!state_.stopping && state_.monitor.link() == ServerLink::kConnected) {
    send_camera(lock);
    if (state_.camera_due) return;  // it could not be sent
    const auto question = writers_.questions.matched() > 0 ? state_.question.next(now) : std::nullopt;
    const auto seed = !question && writers_.seeds.matched() > 0 ? state_.seed.next(now) : std::nullopt;
    const auto offer =
        !question && !seed && writers_.offers.matched() > 0 ? state_.spool.next(now) : std::nullopt;
    const auto request = !question && !seed && !offer && writers_.requests.matched() > 0
                             ? state_.requests.next(now)
                             : std::nullopt;
    if (!question && !seed && !offer && !request) return;
    if (offer) tell_of_proposals(offer->item->proposal.map);
    const uint64_t reference = offer ? state_.sent(offer->item->proposal, offer->command.seq) : 0;
    lock.unlock();
    if (question) {
      report(writers_.questions.write(make_message(*question)), "RelocQuery");
    } else if (seed) {
      report(writers_.seeds.write(make_message(*seed)), "MapSeed");
    } else if (offer) {
      report(writers_.offers.write(make_message(*offer, reference)), "KeyframeOffer");
    } else {
      report(writers_.requests.write(make_message(*request)), "ClientRequest");
    }
    lock.lock();
  }
}

/// Pictures leave this machine, and its user may not want that.
void Sender::tell_of_proposals(MapId map) {
  if (map == state_.proposed_to || state_.use_of_keyframes(map) != KeyframeUse::kProposal) return;
  state_.proposed_to = map;
  log_->info(
      "this map takes proposals: some pictures of it go to the server, whose operator may add them to the "
      "map; --no-proposals keeps them here");
}

wire::MapSeed Sender::make_message(const SeedSlot::Sendable& sendable) const {
  const SeedProposal& proposal = *sendable.proposal;
  wire::MapSeed message;
  message.client = state_.client;
  message.command = sendable.command;
  message.camera = camera_.camera;
  message.camera_version = camera_.version;
  message.lockstep = state_.options.lockstep;
  message.first_time = proposal.first_time;
  message.second_time = proposal.second_time;
  message.first_image = encode_image(*proposal.first_image, encoding_);
  message.second_image = encode_image(*proposal.second_image, encoding_);
  message.trails = proposal.trails;
  message.second_from_first = proposal.second_from_first;
  message.still_mask = bits_of(proposal.still);
  message.second_up = proposal.second_up;
  return message;
}

wire::KeyframeOffer Sender::make_message(const Spool::Sendable& sendable, uint64_t reference) const {
  const KeyframeProposal& proposal = sendable.item->proposal;
  wire::KeyframeOffer message;
  message.client = state_.client;
  message.command = sendable.command;
  message.map = proposal.map;
  message.epoch = proposal.epoch;
  message.revision = proposal.revision;
  message.reference = proposal.reference;
  message.camera_from_reference = proposal.camera_from_reference;
  message.camera = camera_.camera;
  message.camera_version = camera_.version;
  message.lockstep = state_.options.lockstep;
  message.time = sendable.item->time;
  message.image = encode_image(*sendable.item->image, encoding_);
  message.measurements = proposal.measurements;
  message.candidates = proposal.candidates;
  message.reference_command = reference;
  message.still_mask = bits_of(proposal.still);
  message.up = proposal.up;
  message.as_proposal = state_.options.reads_only;
  return message;
}

wire::RelocQuery Sender::make_message(const QuestionSlot::Sendable& sendable) const {
  const PlaceQuestionSent& question = *sendable.question;
  wire::RelocQuery message;
  message.client = state_.client;
  message.command = sendable.command;
  message.map_hint = question.map_hint;
  message.camera = camera_.camera;
  message.camera_version = camera_.version;
  message.lockstep = state_.options.lockstep;
  message.time = question.time;
  message.small_image = encode_image(question.view->small, wire::ImageEncoding::kRaw);
  message.corners = question.view->corners;
  message.up = question.view->up;
  return message;
}

wire::ClientRequest Sender::make_message(const RequestSpool::Sendable& sendable) const {
  wire::ClientRequest message = *sendable.item;
  message.client = state_.client;
  message.command = sendable.command;
  return message;
}

void Sender::report(const Status& written, const char* what) {
  if (!written && warning_.due()) log_->warn("{} could not be sent: {}", what, written.error().message);
}

}  // namespace cairn
