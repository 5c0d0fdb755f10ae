// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "client/inertial/imu_stream.h"
#include "common/wire/rig_messages.h"

namespace cairn {

/// Takes the samples of a rig's IMU out of what the rig says, each once, with how it sits and how its clock
/// goes as far as the rig knows by then; while that is silent, or there is none, those of the encoders
/// instead: a rig with an IMU turns its head against the wearer, which encoders do not know. Pure; one
/// thread, beside that which takes from the queue.
class ImuReceiver {
 public:
  explicit ImuReceiver(ImuQueue& queue) : queue_(queue) {}

  struct News {
    std::string text;  ///< for a person, a sentence that names the rig
    bool is_warning = false;
  };
  /// Takes a state of the rig. Returns whether its samples are of use, when that has changed; nothing for a
  /// rig that sends none.
  std::optional<News> hear(const wire::RigState& state);

 private:
  enum class Use : uint8_t { kNoSamples, kNoMount, kNoClock, kUsed };

  ImuQueue& queue_;
  void hear_encoders(const wire::RigState& state);

  std::optional<Timestamp> newest_;  ///< of the samples put in
  Use use_ = Use::kNoSamples;
};

}  // namespace cairn
