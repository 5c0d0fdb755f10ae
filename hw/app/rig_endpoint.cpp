// SPDX-License-Identifier: Apache-2.0
#include "hw/app/rig_endpoint.h"

#include <exception>
#include <utility>

namespace cairn {
namespace {

constexpr size_t kSpeakersRemembered = 64;

}  // namespace

Result<std::unique_ptr<RigEndpoint>> RigEndpoint::create(const wire::ParticipantOptions& options,
                                                         const std::string& rig) {
  auto participant = wire::Participant::create(options);
  if (!participant) return tl::unexpected(participant.error());
  auto waiter = wire::Waiter::create(*participant);
  if (!waiter) return tl::unexpected(waiter.error());
  auto made = wire::create_all<wire::Reader<wire::RigCommand>, wire::Reader<wire::TrackerStateMessage>>(
      *participant, wire::everybody_to_rig(rig));
  if (!made) return tl::unexpected(made.error());
  auto& [commands, poses] = *made;
  auto states = wire::Writer<wire::RigState>::create(*participant, wire::rig_partition(rig));
  if (!states) return tl::unexpected(states.error());
  if (Status attached = waiter->attach({commands, poses}); !attached) return tl::unexpected(attached.error());
  return std::unique_ptr<RigEndpoint>(new RigEndpoint(rig, options.log, *std::move(participant),
                                                      std::move(commands), std::move(poses),
                                                      *std::move(states), *std::move(waiter)));
}

RigEndpoint::RigEndpoint(std::string rig, Logger log, wire::Participant participant,
                         wire::Reader<wire::RigCommand> commands,
                         wire::Reader<wire::TrackerStateMessage> poses, wire::Writer<wire::RigState> states,
                         wire::Waiter waiter)
    : rig_(std::move(rig)),
      log_(std::move(log)),
      participant_(std::move(participant)),
      commands_(std::move(commands)),
      poses_(std::move(poses)),
      states_(std::move(states)),
      waiter_(std::move(waiter)) {}

RigEndpoint::~RigEndpoint() {
  stop();
}

void RigEndpoint::start(Handler obey, Source take_state, Watcher see, StateWatcher told) {
  obey_ = std::move(obey);
  take_state_ = std::move(take_state);
  see_ = std::move(see);
  told_ = std::move(told);
  thread_ = std::thread([this] { run(); });
}

void RigEndpoint::stop() {
  ends_ = true;
  waiter_.wake();
  if (thread_.joinable()) thread_.join();
}

void RigEndpoint::run() {
  while (!ends_) {
    (void)waiter_.wait(std::chrono::milliseconds(100));
    take_from_speakers(commands_, [this](wire::RigCommand& command, const wire::RigSpeaker& who) {
      command.commander = who.name;
      obey_(std::move(command));
    });
    take_from_speakers(poses_, [this](const wire::TrackerStateMessage& pose, const wire::RigSpeaker& who) {
      if (client_id_from_name(who.name) == pose.client) see_(pose);
    });
    guard([this] { tell_state(); });
  }
}

/// Hands on each message by itself: a fault of one is no fault of those that came with it.
template <typename Message, typename Use>
void RigEndpoint::take_from_speakers(wire::Reader<Message>& reader, const Use& use) {
  guard([&] {
    wire::take_all(reader, [&](wire::Sample<Message>& sample) {
      guard([&] {
        const auto who = sample.message ? speaker_of(reader, sample.publication) : std::nullopt;
        if (who) use(*sample.message, *who);
      });
    });
  });
}

void RigEndpoint::tell_state() {
  const auto state = take_state_();
  if (!state) return;
  // A state that is too long for the wire is a fault of ours that the next one does not have.
  (void)states_.write(*state);
  if (told_) told_(*state);
}

/// The drives are moved by another thread: whatever goes wrong with the network, it must not end that.
template <typename Work>
void RigEndpoint::guard(const Work& work) {
  try {
    work();
  } catch (const std::exception& error) {
    if (warning_.due())
      log_->error("rig {}: a message of the network was lost: {}; if this repeats, restart cairn-rig", rig_,
                  error.what());
  }
}

std::optional<wire::RigSpeaker> RigEndpoint::speaker_of(const wire::ReaderBase& reader,
                                                        wire::PublicationHandle publication) {
  if (const auto known = speakers_.find(publication); known != speakers_.end()) return known->second;
  const auto partition = reader.partition_of(publication);
  auto speaker = partition ? wire::parse_rig_speaker(*partition) : std::nullopt;
  if (!speaker || speaker->rig != rig_) return std::nullopt;
  if (speakers_.size() >= kSpeakersRemembered) speakers_.clear();
  speakers_.emplace(publication, *speaker);
  return speaker;
}

}  // namespace cairn
