// SPDX-License-Identifier: Apache-2.0
// The rig's threads with a network: orders and states by DDS, frames by a pair of sockets, in real time.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <unistd.h>

#include <atomic>
#include <sstream>
#include <stdexcept>
#include <thread>
#include <utility>

#include "common/wire/log_redirect.h"
#include "common/wire/partition.h"
#include "hw/app/bridge_bench.h"
#include "hw/app/calibration_drive.h"
#include "hw/app/rig_endpoint.h"
#include "hw/app/rig_host.h"
#include "hw/app/rig_loop.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using std::chrono::steady_clock;
using ::testing::HasSubstr;
using testing::order_of;
using wire::RigMode;
using wire::RigState;

constexpr uint32_t kDomains = 80;
constexpr int kSlower = 10;  // a busy machine has its pauses: deadlines are half a second and more

/// Homing is soon done.
RigConfiguration near_its_switches() {
  RigConfiguration rig = testing::read_rig(testing::kRigText).value();
  rig.axes[0].home = -0.02;
  rig.axes[0].limits.low = -0.05;
  rig.axes[1].home = 0.02;
  rig.axes[1].limits.high = 0.05;
  return rig;
}

/// Simulated devices at one end of a pair, with a thread of their own.
class DeviceThread {
 public:
  DeviceThread(const RigConfiguration& configuration, std::unique_ptr<CanBus> bus, ScaledClock clock)
      : thread_([this, configuration, clock, bus = std::move(bus)] {
          SimulatedRig devices(configuration, {}, 1, clock.now(), [](const std::string&) {});
          while (!ends_) {
            devices.turn(*bus, clock.now());
            std::this_thread::sleep_for(1ms);
          }
        }) {}
  ~DeviceThread() {
    ends_ = true;
    thread_.join();
  }

 private:
  std::atomic<bool> ends_{false};
  std::thread thread_;
};

class RigNetwork : public ::testing::Test {
 protected:
  void SetUp() override {
    wire::ParticipantOptions options;
    options.role = wire::Role::kRig;
    for (uint32_t i = 0; i < kDomains && !endpoint_; ++i) {
      options.domain = 105 + (static_cast<uint32_t>(getpid()) * 7 + i) % kDomains;
      auto made = RigEndpoint::create(options, "shoulder");
      if (made) endpoint_ = *std::move(made);
    }
    ASSERT_TRUE(endpoint_);
    domain_ = options.domain;
    auto ends = make_bus_pair().value();
    devices_.emplace(configuration_, std::move(ends.second), clock_);
    loop_ =
        RigLoop::start({configuration_, "the pair", clock_, null_logger()}, std::move(ends.first), [this] {
          endpoint_->wake();
        }).value();
    endpoint_->start([this](wire::RigCommand command) { loop_->post(std::move(command)); },
                     [this] { return loop_->take_state(); }, [](const wire::TrackerStateMessage&) {});
    options.role = wire::Role::kRigClient;
    commander_ = wire::Participant::create(options).value();
    orders_ = wire::Writer<wire::RigCommand>::create(*commander_,
                                                     wire::client_to_rig_partition("shoulder", "tracker-1"))
                  .value();
    states_ = wire::Reader<RigState>::create(*commander_, wire::rig_partition("shoulder")).value();
  }
  void TearDown() override {
    if (endpoint_) endpoint_->stop();
  }

  /// Says the order, if any, until a state is so.
  std::optional<RigState> until(const std::optional<wire::RigCommand>& order,
                                const std::function<bool(const RigState&)>& holds) {
    const auto deadline = steady_clock::now() + 60s;
    while (steady_clock::now() < deadline) {
      if (order) (void)orders_->write(*order);
      for (const auto& sample : states_->take()) {
        if (sample.message && holds(*sample.message)) return sample.message;
      }
      std::this_thread::sleep_for(5ms);
    }
    return std::nullopt;
  }
  std::optional<RigState> until_judged(const wire::RigCommand& order) {
    return until(order, [&](const RigState& state) { return state.order == order.order; });
  }

  const wire::LogRedirect quiet_{null_logger()};  // the search for a free domain is noisy
  const RigConfiguration configuration_ = near_its_switches();
  const ScaledClock clock_{kSlower};
  std::unique_ptr<RigEndpoint> endpoint_;
  uint32_t domain_ = 0;
  std::optional<DeviceThread> devices_;
  std::unique_ptr<RigLoop> loop_;
  std::optional<wire::Participant> commander_;
  std::optional<wire::Writer<wire::RigCommand>> orders_;
  std::optional<wire::Reader<RigState>> states_;
};

TEST_F(RigNetwork, OrdersMoveTheDrivesAndTheEndOfTheCommanderLetsThemGo) {
  const auto home = order_of(1, 1, RigMode::kHome);
  ASSERT_TRUE(until(home, [](const RigState& state) { return state.mode == RigMode::kHome; }));
  const auto homed = until(home, [](const RigState& state) { return state.drives_idle; });
  ASSERT_TRUE(homed);
  ASSERT_EQ(homed->trouble, "");
  const auto is_known = [](const RigState& state) {
    return state.axes[0].position_known && state.axes[1].position_known;
  };
  ASSERT_TRUE(until(home, is_known));
  auto look = order_of(1, 2, RigMode::kSaccade);
  look.angles = {0.1, -0.1};
  const auto there = until(look, [](const RigState& state) {
    return state.axes[0].position_known && std::abs(state.axes[0].position - 0.1) < 0.01;
  });
  ASSERT_TRUE(there);
  EXPECT_TRUE(there->has_imu);
  EXPECT_EQ(there->samples.size(), wire::kMaxRigSamples);
  EXPECT_TRUE(there->base_from_camera);
  const auto second = until_judged(order_of(2, 1, RigMode::kNeutral));
  ASSERT_TRUE(second);
  orders_.reset();  // as a commander that is killed
  const auto alone = until(std::nullopt, [](const RigState& state) { return state.drives_idle; });
  ASSERT_TRUE(alone);
  EXPECT_THAT(alone->trouble, HasSubstr("the commander fell silent"));
}

/// Before, any of these ended the program, and with it whoever keeps the drives.
TEST(RigEndpoint, WhatAHandlerThrowsIsToldAndCostsItsMessageOnly) {
  const wire::LogRedirect quiet(null_logger());
  std::ostringstream said;
  wire::ParticipantOptions options;
  options.role = wire::Role::kRig;
  options.log =
      std::make_shared<spdlog::logger>("rig", std::make_shared<spdlog::sinks::ostream_sink_mt>(said, true));
  std::unique_ptr<RigEndpoint> endpoint;
  for (uint32_t i = 0; i < kDomains && !endpoint; ++i) {
    options.domain = 105 + (static_cast<uint32_t>(getpid()) * 13 + i) % kDomains;
    if (auto made = RigEndpoint::create(options, "shoulder")) endpoint = *std::move(made);
  }
  ASSERT_TRUE(endpoint);
  std::atomic<int> obeyed{0};
  const auto obey = [&](const wire::RigCommand& command) {
    if (command.commander == "ada") throw std::runtime_error("no memory, as it were");
    ++obeyed;
  };
  bool states_fail = true;
  const auto state = [&]() -> std::optional<RigState> {
    if (std::exchange(states_fail, false)) throw std::runtime_error("no state");
    RigState now;
    now.rig = "shoulder";
    return now;
  };
  endpoint->start(
      obey, state, [](const wire::TrackerStateMessage&) {},
      [](const RigState&) { throw std::runtime_error("nobody looks"); });
  options.role = wire::Role::kRigClient;
  const auto client = wire::Participant::create(options).value();
  const auto orders_of = [&](const char* name) {
    return wire::Writer<wire::RigCommand>::create(client, wire::client_to_rig_partition("shoulder", name))
        .value();
  };
  auto of_ada = orders_of("ada");
  auto of_eve = orders_of("eve");
  auto states = wire::Reader<RigState>::create(client, wire::rig_partition("shoulder")).value();
  bool is_told = false;
  const auto deadline = steady_clock::now() + 60s;
  while ((!is_told || obeyed < 10) && steady_clock::now() < deadline) {
    (void)of_ada.write(order_of(1, 1, RigMode::kHome));
    (void)of_eve.write(order_of(2, 1, RigMode::kHome));
    std::this_thread::sleep_for(2ms);
    for (const auto& sample : states.take()) is_told = is_told || sample.message;
  }
  endpoint->stop();
  EXPECT_TRUE(is_told) << "after the state that failed";
  EXPECT_GE(obeyed, 10) << "orders that came with those that fail";
  EXPECT_THAT(said.str(), HasSubstr("rig shoulder: a message of the network was lost: "));
}

TEST(RigLoop, ATurnThatThrowsIsToldAndTheDrivesAreLetGoAsEver) {
  std::ostringstream said;
  const auto log =
      std::make_shared<spdlog::logger>("rig", std::make_shared<spdlog::sinks::ostream_sink_mt>(said, true));
  auto ends = make_bus_pair().value();
  std::atomic<int> turns{0};
  auto loop =
      RigLoop::start({near_its_switches(), "the pair", ScaledClock(), log}, std::move(ends.first), [&turns] {
        if (++turns % 2 == 1) throw std::runtime_error("nobody is told");
      }).value();
  const auto deadline = steady_clock::now() + 60s;
  while (turns < 20 && steady_clock::now() < deadline) std::this_thread::sleep_for(5ms);
  EXPECT_GE(turns, 20);
  EXPECT_TRUE(loop->take_state());
  loop->stop();
  bool is_stopped = false;
  while (!is_stopped && steady_clock::now() < deadline) {
    const auto state = loop->take_state();
    is_stopped = state && state->stopped;
    std::this_thread::sleep_for(5ms);
  }
  EXPECT_TRUE(is_stopped) << "by the emergency stop";
  loop.reset();
  EXPECT_THAT(said.str(), HasSubstr("rig shoulder: a turn of its loop failed: nobody is told"));
}

/// A device that sends many of them does not fill the log.
TEST(RigLoop, AFrameThatIsNoMessageIsNamedInTheLogOnce) {
  std::ostringstream said;
  const auto log =
      std::make_shared<spdlog::logger>("rig", std::make_shared<spdlog::sinks::ostream_sink_mt>(said, true));
  auto ends = make_bus_pair().value();
  {
    std::atomic<uint64_t> states{0};
    const auto loop = RigLoop::start({near_its_switches(), "the pair", ScaledClock(), log},
                                     std::move(ends.first), [&states] { ++states; })
                          .value();
    for (int i = 0; i < 20; ++i) (void)ends.second->send({.id = {0x201, false}, .length = 7});
    const uint64_t before = states;
    const auto deadline = steady_clock::now() + 60s;
    while (states < before + 10 && steady_clock::now() < deadline) std::this_thread::sleep_for(5ms);
    ASSERT_GE(states, before + 10);
  }
  const std::string text = said.str();
  const size_t first = text.find("frame 201: 7 bytes, not the 8");
  ASSERT_NE(first, std::string::npos) << text;
  EXPECT_EQ(text.find("frame 201", first + 1), std::string::npos) << text;
}

/// Its participant is a commander's, and its poses come in the rig's partition.
TEST(RigHost, TheTrackerOfTheCameraIsHeardAndACalibrationMovesNothingUnasked) {
  const wire::LogRedirect quiet(null_logger());
  const SessionId session = random_session();
  const ScaledClock clock;
  const RigConfiguration configuration = near_its_switches();
  auto ends = make_bus_pair().value();
  const DeviceThread devices(configuration, std::move(ends.second), clock);
  wire::ParticipantOptions network;
  network.role = wire::Role::kRig;
  std::unique_ptr<RigHost> host;
  for (uint32_t i = 0; i < kDomains && !host; ++i) {
    network.domain = 105 + (static_cast<uint32_t>(getpid()) * 11 + i) % kDomains;
    auto bus = make_bus_pair().value();  // of one that is refused
    auto made = RigHost::open({configuration, "the pair", clock, null_logger(), session}, network,
                              std::move(i == 0 ? ends.first : bus.first));
    if (made) host = *std::move(made);
  }
  ASSERT_TRUE(host);
  network.role = wire::Role::kRigClient;
  const auto tracker = wire::Participant::create(network).value();
  auto poses = wire::Writer<wire::TrackerStateMessage>::create(
                   tracker, wire::client_to_rig_partition("shoulder", "ada"))
                   .value();
  auto orders =
      wire::Writer<wire::RigCommand>::create(tracker, wire::client_to_rig_partition("shoulder", "ada"))
          .value();
  auto states = wire::Reader<RigState>::create(tracker, wire::rig_partition("shoulder")).value();
  std::atomic<bool> ends_now{false};
  std::thread speaks([&] {
    wire::TrackerStateMessage state;
    state.client = client_id_from_name("ada");
    state.session = {1};
    state.state = TrackingState::kTracking;
    while (!ends_now) {
      state.frame_time = clock.wall_time();
      (void)poses.write(state);
      std::this_thread::sleep_for(30ms);
    }
  });
  {
    CalibrationDrive drive(*host, clock, session);
    std::string question;
    std::string refusal;
    const auto refusal_of = [&](const wire::RigCommand& order) {
      const auto deadline = steady_clock::now() + 60s;
      while (steady_clock::now() < deadline) {
        (void)orders.write(order);
        for (const auto& sample : states.take())
          if (sample.message && sample.message->order == order.order) return sample.message->refusal;
        std::this_thread::sleep_for(5ms);
      }
      return std::string("none");
    };
    const auto found = drive.run(configuration, {[&](const std::string& what) {
                                                   question = what;
                                                   refusal = refusal_of(order_of(2, 1, RigMode::kHome));
                                                   return false;
                                                 },
                                                 [](const std::string&) {}, [] { return false; }});
    ASSERT_FALSE(found);
    EXPECT_EQ(found.error().message, "nothing was moved");
    EXPECT_THAT(question, HasSubstr("The axes of shoulder will be homed"));
    EXPECT_THAT(refusal, HasSubstr("the rig is being calibrated"));
  }
  ends_now = true;
  speaks.join();
}

TEST_F(RigNetwork, WhoGivesAnOrderIsWhoHisPartitionSaysWhateverTheOrderClaims) {
  auto of_eve =
      wire::Writer<wire::RigCommand>::create(*commander_, wire::client_to_rig_partition("shoulder", "eve"))
          .value();
  const wire::RigCommand forged = order_of(1, 1, RigMode::kHome);
  ASSERT_NE(forged.commander, "eve");
  EXPECT_TRUE(until(std::nullopt, [&](const RigState& state) {
    (void)of_eve.write(forged);
    return state.order == forged.order && state.ordered_by == "eve";
  }));
}

TEST_F(RigNetwork, ASignalAtTheRigAndAnOrderOfAnybodyStopItAndAnotherRigOfTheHostIsRefused) {
  loop_->stop();
  ASSERT_TRUE(until(std::nullopt, [](const RigState& state) { return state.stopped; }));
  const auto cleared = until_judged(order_of(3, 1, RigMode::kClearStop));
  ASSERT_TRUE(cleared);
  EXPECT_EQ(cleared->refusal, "");
  ASSERT_TRUE(until(std::nullopt, [](const RigState& state) { return !state.stopped; }));
  const auto stopped = until_judged(order_of(4, 1, RigMode::kStop));
  ASSERT_TRUE(stopped);
  EXPECT_TRUE(stopped->stopped);
  wire::ParticipantOptions options;
  options.role = wire::Role::kRig;
  options.domain = domain_;
  const auto second = RigEndpoint::create(options, "head");
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::kRefused);
  EXPECT_THAT(second.error().message, HasSubstr("the rig's in domain"));
}

}  // namespace
}  // namespace cairn
