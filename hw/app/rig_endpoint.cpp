// SPDX-License-Identifier: Apache-2.0
#include "hw/app/rig_endpoint.h"

#include <utility>

#include "common/wire/partition.h"

namespace cairn {

Result<std::unique_ptr<RigEndpoint>> RigEndpoint::create(const wire::ParticipantOptions& options,
                                                         const std::string& rig) {
  auto participant = wire::Participant::create(options);
  if (!participant) return tl::unexpected(participant.error());
  auto waiter = wire::Waiter::create(*participant);
  if (!waiter) return tl::unexpected(waiter.error());
  auto made = wire::create_all<wire::Reader<wire::RigCommand>, wire::Reader<wire::TrackerStateMessage>,
                               wire::Writer<wire::RigState>>(*participant, wire::rig_partition(rig));
  if (!made) return tl::unexpected(made.error());
  auto& [commands, poses, states] = *made;
  if (Status attached = waiter->attach({commands, poses}); !attached) return tl::unexpected(attached.error());
  return std::unique_ptr<RigEndpoint>(new RigEndpoint(
      *std::move(participant), std::move(commands), std::move(poses), std::move(states), *std::move(waiter)));
}

RigEndpoint::RigEndpoint(wire::Participant participant, wire::Reader<wire::RigCommand> commands,
                         wire::Reader<wire::TrackerStateMessage> poses, wire::Writer<wire::RigState> states,
                         wire::Waiter waiter)
    : participant_(std::move(participant)),
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
      if (sample.message) obey(*std::move(sample.message));
    });
    wire::take_all(poses_, [&](wire::Sample<wire::TrackerStateMessage>& sample) {
      if (sample.message) see(*sample.message);
    });
    // A state that is too long for the wire is a fault of ours that the next one does not have.
    if (const auto state = take_state()) (void)states_.write(*state);
  }
}

}  // namespace cairn
