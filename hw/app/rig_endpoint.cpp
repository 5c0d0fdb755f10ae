// SPDX-License-Identifier: Apache-2.0
#include "hw/app/rig_endpoint.h"

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
  return std::unique_ptr<RigEndpoint>(new RigEndpoint(rig, *std::move(participant), std::move(commands),
                                                      std::move(poses), *std::move(states),
                                                      *std::move(waiter)));
}

RigEndpoint::RigEndpoint(std::string rig, wire::Participant participant,
                         wire::Reader<wire::RigCommand> commands,
                         wire::Reader<wire::TrackerStateMessage> poses, wire::Writer<wire::RigState> states,
                         wire::Waiter waiter)
    : rig_(std::move(rig)),
      participant_(std::move(participant)),
      commands_(std::move(commands)),
      poses_(std::move(poses)),
      states_(std::move(states)),
      waiter_(std::move(waiter)) {}

RigEndpoint::~RigEndpoint() {
  stop();
}

void RigEndpoint::start(Handler obey, Source take_state, Watcher see) {
  thread_ = std::thread([this, obey = std::move(obey), take_state = std::move(take_state),
                         see = std::move(see)] { run(obey, take_state, see); });
}

void RigEndpoint::stop() {
  ends_ = true;
  waiter_.wake();
  if (thread_.joinable()) thread_.join();
}

void RigEndpoint::run(const Handler& obey, const Source& take_state, const Watcher& see) {
  while (!ends_) {
    (void)waiter_.wait(std::chrono::milliseconds(100));
    wire::take_all(commands_, [&](wire::Sample<wire::RigCommand>& sample) {
      const auto who = sample.message ? speaker_of(commands_, sample.publication) : std::nullopt;
      if (!who) return;
      sample.message->commander = who->name;
      obey(*std::move(sample.message));
    });
    wire::take_all(poses_, [&](wire::Sample<wire::TrackerStateMessage>& sample) {
      const auto who = sample.message ? speaker_of(poses_, sample.publication) : std::nullopt;
      if (who && client_id_from_name(who->name) == sample.message->client) see(*sample.message);
    });
    // A state that is too long for the wire is a fault of ours that the next one does not have.
    if (const auto state = take_state()) (void)states_.write(*state);
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
