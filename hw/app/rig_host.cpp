// SPDX-License-Identifier: Apache-2.0
#include "hw/app/rig_host.h"

#include <utility>

#include "common/base/exit_deadline.h"

namespace cairn {

Result<std::unique_ptr<RigHost>> RigHost::open(const RigLoopOptions& options,
                                               wire::ParticipantOptions network,
                                               std::unique_ptr<CanBus> bus) {
  network.log = options.log;
  auto endpoint = RigEndpoint::create(network, options.configuration.name);
  if (!endpoint) return tl::unexpected(endpoint.error());
  std::unique_ptr<RigHost> host(new RigHost(std::move(*endpoint), options.log));
  auto loop =
      RigLoop::start(options, std::move(bus), [endpoint = host->endpoint_.get()] { endpoint->wake(); });
  if (!loop) return tl::unexpected(loop.error());
  host->loop_ = std::move(*loop);
  return host;
}

RigHost::RigHost(std::unique_ptr<RigEndpoint> endpoint, Logger log)
    : log_(std::move(log)), endpoint_(std::move(endpoint)) {}

RigHost::~RigHost() {
  if (endpoint_) endpoint_->stop();
}

void RigHost::close(int exit_code) {
  endpoint_->stop();
  loop_.reset();
  const ExitDeadline deadline(exit_code, kClosingPatience, log_);
  endpoint_.reset();
}

void RigHost::start(Watchers watchers) {
  endpoint_->start([this](wire::RigCommand command) { loop_->post(std::move(command)); },
                   [this] { return loop_->take_state(); }, std::move(watchers.of_camera),
                   std::move(watchers.state));
}

}  // namespace cairn
