// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>

#include "common/base/log.h"
#include "common/base/result.h"
#include "common/wire/participant.h"
#include "hw/app/rig_endpoint.h"
#include "hw/app/rig_loop.h"

namespace cairn {

/// The rig at work: its bus and its place in the network, with their threads.
class RigHost {
 public:
  struct Watchers {
    std::function<void(const wire::RigState&)> state;  ///< each that is told
    std::function<void(const wire::TrackerStateMessage&)>
        of_camera;  ///< from the tracker of the rig's camera
  };

  /// Errors: those of RigEndpoint and RigLoop.
  [[nodiscard]] static Result<std::unique_ptr<RigHost>> open(const RigLoopOptions& options,
                                                             wire::ParticipantOptions network,
                                                             std::unique_ptr<CanBus> bus);
  /// Lets the drives go, as RigLoop does.
  ~RigHost();
  /// Lets the drives go and leaves the network, at the end of a process that is to end with that code. Where
  /// the network does not close in time, the process ends here (ExitDeadline).
  void close(int exit_code);
  RigHost(const RigHost&) = delete;
  RigHost& operator=(const RigHost&) = delete;

  /// Orders are obeyed and states told from now on. Watchers are called by one thread, until leave_network().
  void start(Watchers watchers);
  /// Leaves the network: no order comes any more.
  void leave_network() {
    if (endpoint_) endpoint_->stop();
  }
  [[nodiscard]] RigLoop& loop() { return *loop_; }

 private:
  RigHost(std::unique_ptr<RigEndpoint> endpoint, Logger log);

  const Logger log_;
  std::unique_ptr<RigEndpoint> endpoint_;
  std::unique_ptr<RigLoop> loop_;
};

}  // namespace cairn
