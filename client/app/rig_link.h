// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "client/app/frame_observer.h"
#include "client/inertial/imu_stream.h"
#include "client/rig/commander.h"
#include "client/rig/imu_receiver.h"
#include "common/base/log.h"
#include "common/base/rate_limit.h"
#include "common/base/result.h"
#include "common/wire/participant.h"
#include "common/wire/topic.h"
#include "common/wire/waiter.h"

namespace cairn {

struct RigLinkOptions {
  std::string rig;
  std::string name;  ///< of the commander: the client's
  int domain = 0;
  RigAim aim = RigAim::kFollow;
  Logger log = null_logger();
  wire::RigSearchPattern search = wire::RigSearchPattern::kSpiral;
  std::string security = {};  ///< folder of the client's keys; empty: an open site
  CommanderOptions commander = {};
};

/// The line to the rig of this host, with a thread of its own: orders are said 50 times a second, whatever
/// the tracker does, and with them the pose of the newest frame, by which the rig is calibrated and its clock
/// compared with the camera's. A tracker that has had no frame for two seconds is no commander any more:
/// nothing but a stop is said, and the rig lets its drives go. What the rig says of its IMU is for the
/// tracker. Thread-safe.
class RigLink final : public FrameObserver {
 public:
  /// The rig need not be there. Errors: those of Participant::create().
  [[nodiscard]] static Result<std::unique_ptr<RigLink>> open(const RigLinkOptions& options);
  /// Lets the drives go, as close() does.
  ~RigLink() override { close(); }
  /// Lets the drives go, if the rig is there.
  void close();
  RigLink(const RigLink&) = delete;
  RigLink& operator=(const RigLink&) = delete;

  /// Runs a task on the commander, at once.
  template <typename Task>
  auto with(Task task) {
    const std::lock_guard lock(mutex_);
    return task(commander_);
  }
  /// Emergency stop: said at once, not when an order is due.
  void stop();
  [[nodiscard]] std::string describe();
  /// The samples of the IMU that sits with the camera on the rig's head.
  [[nodiscard]] ImuStream& imu() { return imu_; }
  void on_frame(const FrameReport& report) override;

 private:
  RigLink(const RigLinkOptions& options, wire::Participant participant, wire::Writer<wire::RigCommand> orders,
          wire::Writer<wire::TrackerStateMessage> poses, wire::Reader<wire::RigState> states,
          wire::Waiter waiter);
  void run();
  void turn();
  void exchange();
  void hear(const wire::RigState& state);

  const std::string rig_;
  const Logger log_;
  wire::Participant participant_;
  wire::Writer<wire::RigCommand> orders_;
  wire::Writer<wire::TrackerStateMessage> poses_;
  wire::Reader<wire::RigState> states_;
  wire::Waiter waiter_;
  RateLimit warning_;  ///< of the thread
  ImuQueue imu_;
  ImuReceiver imu_receiver_{imu_};  ///< of the thread
  std::mutex mutex_;
  RigCommander commander_;                   ///< guarded by mutex_
  wire::TrackerStateMessage pose_;           ///< of the newest frame; guarded by mutex_
  bool is_pose_due_ = false;                 ///< guarded by mutex_
  std::optional<MonotonicTime> last_frame_;  ///< guarded by mutex_
  std::atomic<bool> ends_{false};
  std::thread thread_;  ///< last: it uses all the above
};

}  // namespace cairn
