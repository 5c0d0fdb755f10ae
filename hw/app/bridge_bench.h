// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "hw/app/bridge.h"
#include "hw/app/simulated_rig.h"
#include "hw/can/socket_bus.h"
#include "hw/rig/test_rig.h"

// For tests only.
namespace cairn::testing {

/// An order of a commander.
inline wire::RigCommand order_of(uint64_t session, uint64_t number, wire::RigMode mode) {
  wire::RigCommand order;
  order.rig = "shoulder";
  order.commander = "tracker-" + std::to_string(session);
  order.order = {{session}, number};
  order.mode = mode;
  return order;
}

/// A bridge and simulated devices at the two ends of a pair of sockets, with a clock of the test's own.
class BridgeBench {
 public:
  /// `truth`: what the devices are, where that is not what the bridge was told.
  explicit BridgeBench(const std::vector<TimedFault>& faults = {},
                       const std::optional<RigCalibration>& truth = std::nullopt,
                       const std::string& text = kRigText)
      : configuration_(read_rig(text).value()),
        ends_(make_bus_pair().value()),
        devices_(with(configuration_, truth.value_or(configuration_.calibration)), faults, 1, now_,
                 [this](const std::string& line) { told.push_back(line); }),
        bridge_(configuration_, now_) {}

  void millisecond() {
    now_ += std::chrono::milliseconds(1);
    devices_.turn(*ends_.second, now_);
    while (const auto frame = ends_.first->receive())
      bridge_.receive({frame->frame, {now_.time_since_epoch().count()}}, now_);
    if (said_again && now_.time_since_epoch() % std::chrono::milliseconds(20) == std::chrono::nanoseconds(0))
      say(*said_again);
    bridge_.advance(now_);
    for (const OutgoingFrame& out : bridge_.take_frames()) (void)ends_.first->send(out.frame, out.urgency);
  }
  /// The time until `holds` is true of the state; nothing if that takes longer than `most`.
  std::optional<std::chrono::milliseconds> until(const std::function<bool(const wire::RigState&)>& holds,
                                                 std::chrono::milliseconds most) {
    for (std::chrono::milliseconds passed(0); passed <= most; ++passed) {
      if (holds(state())) return passed;
      millisecond();
    }
    return std::nullopt;
  }
  void pass(std::chrono::milliseconds time) {
    for (; time.count() > 0; --time) millisecond();
  }
  /// Says an order, and from now on says it again, 50 times a second.
  void order(const wire::RigCommand& command) {
    said_again = command;
    say(command);
  }
  /// Homes the rig, until it is idle again.
  void home() {
    pass(std::chrono::milliseconds(200));
    order(order_of(1, 1, wire::RigMode::kHome));
    ASSERT_EQ(state().refusal, "");
    const auto is_idle = [](const wire::RigState& state) { return state.drives_idle; };
    const bool is_homed = until(is_idle, std::chrono::seconds(30)).has_value();
    devices_.tell_extremes();
    ASSERT_TRUE(is_homed) << ::testing::PrintToString(told);
    ASSERT_EQ(state().trouble, "");
    ASSERT_TRUE(until(
        [](const wire::RigState& state) {
          return state.axes[0].position_known && state.axes[1].position_known;
        },
        std::chrono::seconds(1)));
  }
  /// Says an order once, with a target seen in an image of 30 ms ago.
  void say(const wire::RigCommand& command) {
    bridge_.obey(command, now_, now_ - std::chrono::milliseconds(30));
  }
  [[nodiscard]] wire::RigState state() const { return bridge_.state({now_.time_since_epoch().count()}); }
  [[nodiscard]] RigBridge& bridge() { return bridge_; }
  [[nodiscard]] SimulatedRig& devices() { return devices_; }
  [[nodiscard]] MonotonicTime now() const { return now_; }

  std::vector<std::string> told;  ///< by the devices
  std::optional<wire::RigCommand> said_again;

 private:
  static RigConfiguration with(RigConfiguration configuration, const RigCalibration& truth) {
    configuration.calibration = truth;
    return configuration;
  }

  MonotonicTime now_{std::chrono::hours(1)};
  RigConfiguration configuration_;
  std::pair<std::unique_ptr<CanBus>, std::unique_ptr<CanBus>> ends_;
  SimulatedRig devices_;
  RigBridge bridge_;
};

}  // namespace cairn::testing
