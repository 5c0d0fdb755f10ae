// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/base/log.h"
#include "common/base/rate_limit.h"
#include "common/wire/rig_messages.h"
#include "hw/app/bridge.h"
#include "hw/app/scaled_clock.h"
#include "hw/app/wake_up.h"
#include "hw/can/can_bus.h"

namespace cairn {

struct RigLoopOptions {
  RigConfiguration configuration;
  std::string interface_name;  ///< for messages
  ScaledClock clock;
  Logger log = null_logger();
  std::optional<SessionId> reserved_for = std::nullopt;  ///< RigBridge::reserve_for()
};

/// The thread that has the bus: it takes frames, steps the rig, and sends what the rig says, as soon as
/// anything comes or falls due. It never waits for anything else. A turn that throws is logged, and the next
/// one comes: the drives are let go by their watchdogs where none comes to its end. Its methods are
/// thread-safe.
class RigLoop {
 public:
  /// Starts the thread at once. It calls `told` when there is a state to take. Error kIo.
  [[nodiscard]] static Result<std::unique_ptr<RigLoop>> start(const RigLoopOptions& options,
                                                              std::unique_ptr<CanBus> bus,
                                                              std::function<void()> told);
  /// Lets the drives go, and waits for that for half a second at most.
  ~RigLoop();
  RigLoop(const RigLoop&) = delete;
  RigLoop& operator=(const RigLoop&) = delete;

  void post(wire::RigCommand command);
  /// Emergency stop. Nothing in it may wait long: it is what a signal asks for.
  void stop();
  /// These do what RigBridge's do; the samples have stamps of the rig's own clock.
  void set_camera_clock(const wire::RigCameraClock& clock);
  [[nodiscard]] std::vector<GyroSample> take_gyro();
  /// The newest state since the last call, if there is one: 100 a second.
  [[nodiscard]] std::optional<wire::RigState> take_state();

 private:
  RigLoop(const RigLoopOptions& options, std::unique_ptr<CanBus> bus, std::function<void()> told,
          WakeUp wake_up);
  void run();
  void turn(MonotonicTime now);
  void stop_now(MonotonicTime now);
  [[nodiscard]] size_t commands_waiting();
  [[nodiscard]] std::optional<wire::RigCommand> take_command();
  void send();
  void publish(MonotonicTime now);
  void collect_gyro();
  void tell_strange_frames();
  void tell_changes(const wire::RigState& state, const std::string& bus_trouble);
  void wait();
  [[nodiscard]] bool is_over(MonotonicTime now);

  const RigLoopOptions options_;
  const std::unique_ptr<CanBus> bus_;
  const std::function<void()> told_;
  const WakeUp wake_up_;
  RigBridge bridge_;
  MonotonicTime next_state_;
  std::optional<MonotonicTime> closing_until_;
  std::string trouble_;  ///< as last logged, and likewise:
  std::string bus_trouble_;
  std::string refusal_;
  std::string doing_;
  uint64_t strange_frames_ = 0;
  RateLimit strange_told_{std::chrono::seconds(10)};
  RateLimit failure_told_;

  std::atomic<bool> ends_{false};
  std::atomic<bool> stop_asked_{false};
  std::mutex mutex_;  ///< for what follows
  std::deque<wire::RigCommand> commands_;
  std::optional<wire::RigState> state_;
  std::optional<wire::RigCameraClock> camera_clock_;  ///< to be handed on
  std::vector<GyroSample> gyro_;
  std::thread thread_;
};

}  // namespace cairn
