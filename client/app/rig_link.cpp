// SPDX-License-Identifier: Apache-2.0
#include "client/app/rig_link.h"

#include <chrono>
#include <random>
#include <utility>

#include "common/wire/partition.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kPeriod{20};     // of saying an order; a rig waits for 40 ms at least
constexpr milliseconds kStuck{2000};    // without a frame
constexpr milliseconds kPatience{500};  // for the rig to have heard the last order

SessionId random_session() {
  std::random_device device;
  return {uint64_t{device()} << 32 | device() | 1};
}

}  // namespace

Result<std::unique_ptr<RigLink>> RigLink::open(const RigLinkOptions& options) {
  wire::ParticipantOptions joining;
  joining.role = wire::Role::kRigClient;
  joining.domain = static_cast<uint32_t>(options.domain);
  joining.security = options.security;
  auto participant = wire::Participant::create(joining);
  if (!participant) return tl::unexpected(participant.error());
  auto waiter = wire::Waiter::create(*participant);
  if (!waiter) return tl::unexpected(waiter.error());
  auto made = wire::create_all<wire::Writer<wire::RigCommand>, wire::Writer<wire::TrackerStateMessage>>(
      *participant, wire::client_to_rig_partition(options.rig, options.name));
  if (!made) return tl::unexpected(made.error());
  auto& [orders, poses] = *made;
  auto states = wire::Reader<wire::RigState>::create(*participant, wire::rig_partition(options.rig));
  if (!states) return tl::unexpected(states.error());
  if (Status attached = waiter->attach({*states}); !attached) return tl::unexpected(attached.error());
  return std::unique_ptr<RigLink>(new RigLink(options, *std::move(participant), std::move(orders),
                                              std::move(poses), *std::move(states), *std::move(waiter)));
}

RigLink::RigLink(const RigLinkOptions& options, wire::Participant participant,
                 wire::Writer<wire::RigCommand> orders, wire::Writer<wire::TrackerStateMessage> poses,
                 wire::Reader<wire::RigState> states, wire::Waiter waiter)
    : rig_(options.rig),
      log_(options.log),
      participant_(std::move(participant)),
      orders_(std::move(orders)),
      poses_(std::move(poses)),
      states_(std::move(states)),
      waiter_(std::move(waiter)),
      commander_(options.rig, options.name, random_session(), options.aim, options.search,
                 options.commander) {
  pose_.client = client_id_from_name(options.name);
  pose_.session = random_session();
  thread_ = std::thread([this] { run(); });
}

void RigLink::on_frame(const FrameReport& report) {
  const std::lock_guard lock(mutex_);
  pose_.state = report.result.state;
  pose_.map = report.result.map;
  pose_.epoch = report.result.epoch;
  pose_.revision = report.result.revision;
  pose_.camera_from_map = report.result.camera_from_map;
  pose_.quality = report.result.quality;
  pose_.frame_time = report.frame.time;
  is_pose_due_ = true;
  last_frame_ = steady_clock::now();
}

void RigLink::stop() {
  with([](RigCommander& commander) { commander.stop(); });
  waiter_.wake();
}

void RigLink::close() {
  if (!thread_.joinable()) return;
  with([](RigCommander& commander) { commander.close(); });
  ends_ = true;
  thread_.join();
}

void RigLink::run() {
  while (!ends_) turn();
  const auto deadline = steady_clock::now() + kPatience;
  while (steady_clock::now() < deadline && !with([](RigCommander& commander) { return commander.is_over(); }))
    turn();
}

/// Does one exchange with the rig. Whatever is wrong with it, the rig waits for the next order.
void RigLink::turn() {
  try {
    exchange();
  } catch (const std::exception& error) {
    if (warning_.due()) log_->error("rig {}: {}", rig_, error.what());
  }
}

/// States come faster than orders go. A stop does not wait until one is due.
void RigLink::exchange() {
  const auto end = steady_clock::now() + kPeriod;
  const auto is_urgent = [this] {
    return with([](RigCommander& commander) { return commander.is_urgent(); });
  };
  for (auto left = kPeriod; left > left.zero() && !is_urgent();
       left = std::chrono::ceil<milliseconds>(end - steady_clock::now())) {
    (void)waiter_.wait(left);
    wire::take_all(states_, [this](wire::Sample<wire::RigState>& sample) {
      if (sample.message && sample.message->rig == rig_) hear(*sample.message);
    });
  }
  const auto order = with([](RigCommander& commander) { return commander.command(steady_clock::now()); });
  std::optional<wire::TrackerStateMessage> pose;
  bool is_stuck = false;
  {
    const std::lock_guard lock(mutex_);
    if (std::exchange(is_pose_due_, false)) pose = pose_;
    is_stuck = last_frame_ && steady_clock::now() - *last_frame_ > kStuck;
  }
  const bool lets_go = order && (order->mode == wire::RigMode::kStop || order->mode == wire::RigMode::kIdle);
  // Both are said again at once.
  if (order && (!is_stuck || lets_go)) (void)orders_.write(*order);
  if (pose) (void)poses_.write(*pose);
}

void RigLink::hear(const wire::RigState& state) {
  if (const auto news = imu_receiver_.hear(state))
    log_->log(news->is_warning ? spdlog::level::warn : spdlog::level::info, "{}", news->text);
  with([&](RigCommander& commander) { commander.hear(state, steady_clock::now()); });
}

std::string RigLink::describe() {
  return with([](RigCommander& commander) { return commander.describe(steady_clock::now()); });
}

}  // namespace cairn
