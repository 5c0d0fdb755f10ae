// SPDX-License-Identifier: Apache-2.0
#include "client/rig/imu_receiver.h"

#include <fmt/format.h>

#include <chrono>
#include <utility>

namespace cairn {
namespace {

constexpr std::chrono::seconds kSetBack{1};        // then the rig's clock is another one
constexpr std::chrono::milliseconds kSilent{100};  // then the rig has let its drives go

std::optional<ImuMount> mount_of(const wire::RigState& state) {
  const auto offset = wire::camera_offset(state);
  if (!state.camera_from_imu || !offset) return std::nullopt;
  return ImuMount{state.camera_from_imu->normalized(), std::chrono::nanoseconds(-*offset)};
}

std::string source_of(const wire::RigCameraClock& clock) {
  return clock.known ? fmt::format("estimated at work to {:.1f} ms", 1000 * clock.sigma) : "as calibrated";
}

}  // namespace

/// Takes a sample of the encoders. While the offset of the clocks is not known, the camera is taken to be
/// stamped by the host's clock.
void ImuReceiver::hear_encoders(const wire::RigState& state) {
  if (!state.base_from_camera) return;
  const std::chrono::nanoseconds offset(wire::camera_offset(state).value_or(0));
  queue_.put(EncoderSample{state.time + -offset, state.base_from_camera->normalized()});
}

std::optional<ImuReceiver::News> ImuReceiver::hear(const wire::RigState& state) {
  if (state.samples.empty() || state.time - state.samples.back().time > kSilent) hear_encoders(state);
  if (state.samples.empty()) return std::nullopt;
  if (newest_ && state.samples.back().time < *newest_ + -kSetBack) newest_.reset();
  for (const wire::RigImuSample& sample : state.samples) {
    if (newest_ && sample.time <= *newest_) continue;
    newest_ = sample.time;
    queue_.put(ImuSample{sample.time, sample.rate.cast<double>(), sample.acceleration.cast<double>()});
  }
  const auto mount = mount_of(state);
  queue_.set_mount(mount);
  const Use use = !state.camera_from_imu ? Use::kNoMount : !mount ? Use::kNoClock : Use::kUsed;
  if (std::exchange(use_, use) == use) return std::nullopt;
  switch (use) {
    case Use::kNoMount:
      return News{fmt::format("rig {}: its configuration does not say how camera and IMU sit on the head, so "
                              "the gyro is not used; `cairn-rig calibrate` determines it",
                              state.rig),
                  true};
    case Use::kNoClock:
      return News{fmt::format("rig {}: it is not known how stamps of the camera lie to those of the IMU, so "
                              "the gyro is not used until the rig has estimated it; `cairn-rig calibrate` "
                              "determines it for good",
                              state.rig),
                  true};
    case Use::kNoSamples:
    case Use::kUsed:
      break;
  }
  return News{
      fmt::format("rig {}: its gyro is used; stamps of the camera lack {:.1f} ms to the IMU's, {}", state.rig,
                  1e-6 * static_cast<double>(*wire::camera_offset(state)), source_of(state.camera_clock)),
      false};
}

}  // namespace cairn
