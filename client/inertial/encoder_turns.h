// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "common/base/time.h"

namespace cairn {

/// The rotation from a rig's camera to the base that carries the rig, by the encoders.
struct EncoderSample {
  Timestamp time;  ///< by the camera's clock
  Eigen::Quaterniond base_from_camera = Eigen::Quaterniond::Identity();
};

struct EncoderTurnOptions {
  double most_gap = 0.05;    ///< [s] between two samples
  double most_ahead = 0.02;  ///< [s] that the newest one is taken for the present
  uint64_t kept = 200;       ///< samples: two seconds
};

/// The turns of a camera by the encoders of the rig that carries it, true as long as what carries the rig
/// stands still. Pure; one thread.
class EncoderTurns {
 public:
  explicit EncoderTurns(const EncoderTurnOptions& options) : options_(options) {}

  /// Adds samples in order of time. When time does not go on, all samples before are forgotten.
  void add(std::span<const EncoderSample> samples);
  /// The turn of the camera between two moments (`to` from `from`). Nothing where samples are missing: before
  /// the first, in a gap of more than 50 ms, or when the newest is older than one of them by more than 20 ms.
  [[nodiscard]] std::optional<Eigen::Quaterniond> turn(Timestamp from, Timestamp to) const;

 private:
  [[nodiscard]] std::optional<Eigen::Quaterniond> at(Timestamp time) const;

  EncoderTurnOptions options_;
  std::vector<EncoderSample> samples_;  ///< of the last seconds
};

}  // namespace cairn
