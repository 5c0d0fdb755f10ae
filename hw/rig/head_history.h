// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <deque>
#include <optional>

#include "common/base/time.h"

namespace cairn {

/// The attitudes of the head in the last second, for images, which show the past. Pure.
class HeadHistory {
 public:
  struct Head {
    Eigen::Quaterniond world_from_head;
    Eigen::Vector3d way = Eigen::Vector3d::Zero();  ///< by the steps of the wearer [m], as Sway has it
  };
  /// Times that run back begin a new history.
  void add(MonotonicTime when, const Head& head);
  /// Between the samples; nothing before the oldest and long after the newest.
  [[nodiscard]] std::optional<Head> at(MonotonicTime when) const;

 private:
  struct Entry {
    MonotonicTime when;
    Head head;
  };
  std::deque<Entry> entries_;
};

}  // namespace cairn
