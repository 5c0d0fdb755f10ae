// SPDX-License-Identifier: Apache-2.0
#include "hw/app/calibration_drive.h"

#include <algorithm>
#include <chrono>
#include <random>
#include <thread>
#include <utility>

#include "common/geometry/se3.h"

namespace cairn {
namespace {

constexpr size_t kMostPoses = 600;                // 20 s of a camera
constexpr std::chrono::milliseconds kPeriod{10};  // of looking and ordering; a rig waits for 40 ms at least

wire::RigMode mode_of(TourOrder::What what) {
  switch (what) {
    case TourOrder::What::kHome:
      return wire::RigMode::kHome;
    case TourOrder::What::kJog:
      return wire::RigMode::kJog;
    case TourOrder::What::kNothing:
    case TourOrder::What::kIdle:
      break;
  }
  return wire::RigMode::kIdle;
}

}  // namespace

SessionId random_session() {
  std::random_device device;
  return {uint64_t{device()} << 32 | device() | 1};
}

TourReport report_of(const wire::RigState& state, const wire::CommandId& mine, Timestamp when) {
  TourReport report;
  report.when = when;
  report.is_homed = std::all_of(state.axes.begin(), state.axes.end(),
                                [](const wire::RigAxisState& axis) { return axis.position_known; });
  report.is_idle = state.drives_idle;
  report.angles = {state.axes[0].position, state.axes[1].position};
  report.rates = {state.axes[0].rate, state.axes[1].rate};
  report.trouble = state.trouble;
  if (report.trouble.empty() && state.order == mine) report.trouble = state.refusal;
  return report;
}

TourPose pose_of(const wire::TrackerStateMessage& state, Timestamp when) {
  const bool is_tracked = state.state == TrackingState::kTracking || state.state == TrackingState::kPoor;
  return {when, is_tracked, to_hex(state.map.bytes) + " " + std::to_string(state.epoch.value),
          state.camera_from_map.rotation().conjugate(), state.camera_from_map.center()};
}

TourCommander::TourCommander(std::string rig, SessionId session) {
  command_.rig = std::move(rig);
  command_.commander = "calibrate";
  command_.order.session = session;
}

std::optional<wire::RigCommand> TourCommander::say(const TourOrder& order) {
  if (std::exchange(what_, order.what) != order.what) ++command_.order.seq;
  if (order.what == TourOrder::What::kNothing) return std::nullopt;
  command_.mode = mode_of(order.what);
  command_.rates = {order.rates.pan, order.rates.tilt};
  return command_;
}

CalibrationDrive::CalibrationDrive(RigHost& host, ScaledClock clock, SessionId session)
    : host_(host), clock_(clock), session_(session) {
  host_.start({[this](const wire::RigState& state) {
                 const std::lock_guard lock(mutex_);
                 state_ = state;
               },
               [this](const wire::TrackerStateMessage& state) {
                 const Timestamp when{clock_.at(state.frame_time).time_since_epoch().count()};
                 const std::lock_guard lock(mutex_);
                 if (poses_.size() == kMostPoses) poses_.erase(poses_.begin());  // while a person thinks
                 poses_.push_back(pose_of(state, when));
               }});
}

void CalibrationDrive::hand_in(CalibrationTour* tour) {
  std::optional<wire::RigState> state;
  std::vector<TourPose> poses;
  {
    const std::lock_guard lock(mutex_);
    state.swap(state_);
    poses.swap(poses_);
  }
  if (state) tour->take(report_of(*state, commander_->newest(), now()));
  for (const GyroSample& sample : host_.loop().take_gyro()) tour->sense(sample);
  for (const TourPose& pose : poses) tour->see(pose);
}

Result<TourFindings> CalibrationDrive::run(const RigConfiguration& configuration, const Person& person) {
  auto tour = CalibrationTour::plan(configuration, now());
  if (!tour) return tl::unexpected(tour.error());
  commander_.emplace(configuration.name, session_);
  while (!tour->is_over()) {
    if (person.interrupts()) return fail(ErrorCode::kRefused, "interrupted; the drives are let go");
    hand_in(&*tour);
    const auto order = tour->advance(now());
    for (const std::string& words : tour->take_words()) person.hears(words);
    if (!order) return tl::unexpected(order.error());
    if (tour->is_ready()) {
      if (!person.agrees(tour->announcement())) return fail(ErrorCode::kRefused, "nothing was moved");
      hand_in(&*tour);  // what has come while the person thought
      tour->begin(now());
      continue;
    }
    if (const auto command = commander_->say(*order)) host_.loop().post(*command);
    std::this_thread::sleep_for(kPeriod);
  }
  return tour->conclude();
}

}  // namespace cairn
