// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "common/geometry/se3.h"
#include "common/map/snapshot.h"

namespace cairn {

struct KeyframeRoundsOptions {
  uint64_t per_frame = 3;    ///< as many as cost a frame's time
  double look_aside = 0.12;  ///< [rad] between successive rounds
};

/// Poses to look from when nothing is known of where the camera is in a map and nobody can be asked: those of
/// its keyframes, round after round, each round turned another way, since a camera that stands still would
/// never come nearer to a keyframe's direction. One thread.
class KeyframeRounds {
 public:
  explicit KeyframeRounds(const KeyframeRoundsOptions& options) : options_(options) {}

  /// The next pose; nothing for a map without keyframes.
  [[nodiscard]] std::optional<SE3> next(const MapSnapshot& map) {
    static const std::array<Eigen::Vector3d, 5> turns = {Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitY(),
                                                         -Eigen::Vector3d::UnitY(), Eigen::Vector3d::UnitX(),
                                                         -Eigen::Vector3d::UnitX()};
    const size_t count = map.keyframe_count();
    if (count == 0) return std::nullopt;
    size_t left = taken_ % count;
    const Eigen::Vector3d turn = options_.look_aside * turns[taken_ / count % turns.size()];
    ++taken_;
    for (const auto& block : map.keyframe_blocks) {
      for (size_t slot = 0; slot < block->keyframes.size(); ++slot) {
        if ((block->live >> slot & 1) == 0 || left-- > 0) continue;
        return SE3(so3_exp(turn), Eigen::Vector3d::Zero()) * block->keyframes[slot].camera_from_map;
      }
    }
    return std::nullopt;
  }

 private:
  KeyframeRoundsOptions options_;
  size_t taken_ = 0;
};

}  // namespace cairn
