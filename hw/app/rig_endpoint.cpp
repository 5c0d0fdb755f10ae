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
  auto made = wire::create_all<wire::Reader<wire::RigCommand>, wire::Writer<wire::RigState>>(
      *participant, wire::rig_partition(rig));
  if (!made) return tl::unexpected(made.error());
  auto& [commands, states] = *made;
  if (Status attached = waiter->attach({commands}); !attached) return tl::unexpected(attached.error());
  return std::unique_ptr<RigEndpoint>(
      new RigEndpoint(*std::move(participant), std::move(commands), std::move(states), *std::move(waiter)));
}

RigEndpoint::RigEndpoint(wire::Participant participant, wire::Reader<wire::RigCommand> commands,
                         wire::Writer<wire::RigState> states, wire::Waiter waiter)
    : participant_(std::move(participant)),
      commands_(std::move(commands)),
      states_(std::move(states)),
      waiter_(std::move(waiter)) {}

RigEndpoint::~RigEndpoint() {
  stop();
}

void RigEndpoint::start(Handler obey, Source take_state) {
  thread_ = std::thread(
      [this, obey = std::move(obey), take_state = std::move(take_state)] { run(obey, take_state); });
}

void RigEndpoint::stop() {
  ends_ = true;
  waiter_.wake();
  if (thread_.joinable()) thread_.join();
}

void RigEndpoint::run(const Handler& obey, const Source& take_state) {
  while (!ends_) {
    (void)waiter_.wait(std::chrono::milliseconds(100));
    wire::take_all(commands_, [&](wire::Sample<wire::RigCommand>& sample) {
      if (sample.message) obey(*std::move(sample.message));
    });
    // A state that is too long for the wire is a fault of ours that the next one does not have.
    if (const auto state = take_state()) (void)states_.write(*state);
  }
}

}  // namespace cairn
