// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <deque>
#include <optional>

#include "common/base/time.h"

namespace cairn {

/// How the head stood in the last second: what a picture shows is older than it. Pure.
class HeadHistory {
 public:
  /// Times that run back begin a new history.
  void add(MonotonicTime when, const Eigen::Quaterniond& world_from_head);
  /// Between the samples; nothing before the oldest and long after the newest.
  [[nodiscard]] std::optional<Eigen::Quaterniond> at(MonotonicTime when) const;

 private:
  struct Entry {
    MonotonicTime when;
    Eigen::Quaterniond world_from_head;
  };
  std::deque<Entry> entries_;
};

}  // namespace cairn
