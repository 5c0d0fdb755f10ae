// SPDX-License-Identifier: Apache-2.0
#include "client/app/rig_link.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/ostream_sink.h>
#include <unistd.h>

#include <chrono>
#include <mutex>
#include <sstream>
#include <stdexcept>
#include <string_view>
#include <thread>
#include <utility>

#include "common/wire/log_redirect.h"
#include "common/wire/partition.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using std::chrono::steady_clock;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

constexpr uint32_t kDomains = 80;

/// What says a rig's states, and the link to it.
class RigLinkTest : public ::testing::Test {
 protected:
  void SetUp() override {
    wire::ParticipantOptions options;
    options.role = wire::Role::kRig;
    for (uint32_t i = 0; i < kDomains && !rig_; ++i) {
      options.domain = 100 + (static_cast<uint32_t>(getpid()) * 11 + i) % kDomains;
      if (auto made = wire::Participant::create(options)) rig_.emplace(*std::move(made));
    }
    domain_ = static_cast<int>(options.domain);
    ASSERT_TRUE(rig_);
    states_.emplace(wire::Writer<wire::RigState>::create(*rig_, wire::rig_partition("shoulder")).value());
    state_.rig = "shoulder";
    open_link(log_);
  }
  void open_link(const Logger& log) {
    link_.reset();
    auto link = RigLink::open({"shoulder", "tracker", domain_, RigAim::kFollow, log});
    ASSERT_TRUE(link) << link.error().message;
    link_ = *std::move(link);
  }

  /// Says states of a hundredth of a second each, until that holds.
  template <typename Holds>
  bool until(Holds holds) {
    for (const auto deadline = steady_clock::now() + 60s; steady_clock::now() < deadline;) {
      state_.time = state_.time + 10ms;
      state_.samples.push_back({state_.time, Eigen::Vector3f(1, 2, 3), Eigen::Vector3f(0, 0, 9.8F)});
      if (state_.samples.size() > wire::kMaxRigSamples) state_.samples.erase(state_.samples.begin());
      (void)states_->write(state_);
      std::this_thread::sleep_for(2ms);
      link_->imu().take({}, &taken_);
      if (holds()) return true;
    }
    return false;
  }

  const wire::LogRedirect quiet_{null_logger()};  // the search for a free domain is noisy
  std::ostringstream said_;
  const Logger log_ =
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(said_));
  int domain_ = 0;
  std::optional<wire::Participant> rig_;
  std::optional<wire::Writer<wire::RigState>> states_;
  std::unique_ptr<RigLink> link_;
  wire::RigState state_;
  std::vector<ImuSample> taken_;
};

TEST_F(RigLinkTest, SamplesOfTheRigAreForTheTrackerOnceItKnowsHowTheImuSits) {
  ASSERT_TRUE(until([this] { return taken_.size() > 20; }));
  EXPECT_EQ(taken_.front().rate, Eigen::Vector3d(1, 2, 3));
  for (size_t i = 1; i < taken_.size(); ++i) EXPECT_LT(taken_[i - 1].time, taken_[i].time);
  EXPECT_FALSE(link_->imu().mount());
  state_.camera_from_imu = Eigen::Quaterniond::Identity();
  state_.calibrated_offset = 2'000'000;
  ASSERT_TRUE(until([this] { return link_->imu().mount().has_value(); }));
  EXPECT_EQ(link_->imu().mount()->clock_offset, -2ms);
  link_.reset();  // and with it the thread that speaks
  EXPECT_THAT(said_.str(), HasSubstr("`cairn-rig calibrate` determines it"));
  EXPECT_THAT(said_.str(), HasSubstr("its gyro is used"));
}

/// What goes wrong with a state: here nobody takes what is to be said of its IMU.
TEST_F(RigLinkTest, WhatAnExchangeThrowsIsToldAndTheNextStateIsHeard) {
  struct FullOnce : spdlog::sinks::base_sink<std::mutex> {
    explicit FullOnce(std::ostream* out) : out_(*out) {}
    void sink_it_(const spdlog::details::log_msg& message) override {
      if (std::exchange(is_full_, false)) throw std::runtime_error("the log is full, as it were");
      out_ << std::string_view(message.payload.data(), message.payload.size()) << '\n';
    }
    void flush_() override {}

   private:
    std::ostream& out_;
    bool is_full_ = true;
  };
  const auto log = std::make_shared<spdlog::logger>("test", std::make_shared<FullOnce>(&said_));
  log->set_error_handler([](const std::string& what) { throw std::runtime_error(what); });
  open_link(log);
  ASSERT_TRUE(until([this] { return taken_.size() > 20; }));
  state_.camera_from_imu = Eigen::Quaterniond::Identity();
  state_.calibrated_offset = 2'000'000;
  ASSERT_TRUE(until([this] { return link_->imu().mount().has_value(); }));
  link_.reset();  // and with it the thread that speaks
  EXPECT_THAT(said_.str(), HasSubstr("rig shoulder: the log is full"));
  EXPECT_THAT(said_.str(), HasSubstr("its gyro is used"));
}

TEST_F(RigLinkTest, AStopIsSaidAtOnceAndOrdersOnlyToWhoIsThere) {
  auto orders = wire::Reader<wire::RigCommand>::create(*rig_, wire::everybody_to_rig("shoulder")).value();
  std::vector<wire::RigCommand> heard;
  const auto hear = [&] {
    for (const auto& sample : orders.take()) {
      if (sample.message) heard.push_back(*sample.message);
    }
    return !heard.empty();
  };
  link_->stop();
  EXPECT_FALSE(link_->with([](RigCommander& commander) { return commander.aim() != RigAim::kFollow; }));
  for (const auto deadline = steady_clock::now() + 60s; !hear() && steady_clock::now() < deadline;)
    std::this_thread::sleep_for(1ms);
  ASSERT_FALSE(heard.empty()) << "also to a rig that is not heard";
  EXPECT_EQ(heard.front().mode, wire::RigMode::kStop);
  EXPECT_EQ(heard.front().commander, "tracker");
  heard.clear();
  state_.stopped = true;
  ASSERT_TRUE(until([&] { return hear() && heard.back().mode == wire::RigMode::kIdle; })) << "it is obeyed";
}

TEST_F(RigLinkTest, ATrackerWithoutFramesIsNoCommanderAndOneThatClosesLetsTheDrivesGo) {
  auto orders = wire::Reader<wire::RigCommand>::create(*rig_, wire::everybody_to_rig("shoulder")).value();
  std::optional<wire::RigCommand> last;
  int heard = 0;
  const auto hear = [&] {
    for (const auto& sample : orders.take()) {
      if (!sample.message) continue;
      last = *sample.message;
      ++heard;
    }
    return last && last->mode == wire::RigMode::kFollow;
  };
  for (auto& axis : state_.axes) axis.condition = wire::RigAxisCondition::kActive;
  ASSERT_TRUE(until(hear));
  const Frame frame;
  const FrameResult result;
  const MapSnapshotPtr snapshot;
  const LabelListPtr labels;
  link_->on_frame({0, frame, result, FrameState::kLost, snapshot, labels, {}, {}, {}, {}, {}, {}});
  auto silent_since = steady_clock::now();
  ASSERT_TRUE(until([&] {
    const int before = heard;
    (void)hear();
    if (heard != before) silent_since = steady_clock::now();
    return steady_clock::now() - silent_since > 500ms;
  })) << "two seconds without a frame";
  link_->close();
  (void)hear();
  EXPECT_EQ(last->mode, wire::RigMode::kIdle);
}

}  // namespace
}  // namespace cairn
