// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <mutex>
#include <string>
#include <vector>

#include "common/base/histogram.h"
#include "server/mapping/map_maker.h"

namespace cairn {

/// Count and quantiles of one kind of work.
struct WorkSummary {
  std::string name;
  size_t count = 0;
  double p50 = 0;
  double p95 = 0;
  double p99 = 0;
  double max = 0;
};

/// What the map makers of a server have done and how long it took, all maps together, since its start.
/// Thread-safe; a call is short beside the work that it counts.
class WorkTimes {
 public:
  /// Counts the time from when an offer came to when it was looked at.
  void waited(std::chrono::nanoseconds wall);
  /// Counts the processor time of judging an offer and taking it in. Offers that are refused before their
  /// image is decoded count as well, and take much less than the others.
  void judged(std::chrono::nanoseconds cpu);
  /// Counts the processor time of a piece of work, of all its parts if it was interrupted, and the
  /// observations of an adjustment.
  void worked(const StepReport& report, std::chrono::nanoseconds cpu);
  /// Counts the time from when an offer came to the revision with the points made of it.
  void points_published(std::chrono::nanoseconds wall);

  /// Counts the time from when an offer came to when queries are answered with its keyframe.
  void searchable(std::chrono::nanoseconds wall);
  /// Counts the processor time of looking for a keyframe in other maps.
  void checked_for_overlaps(std::chrono::nanoseconds cpu);

  /// Summaries of all that has been counted: "offer_waited_ms", "local_adjustment_cpu_ms",
  /// "local_adjustment_observations", ...
  [[nodiscard]] std::vector<WorkSummary> summaries() const;

 private:
  static constexpr size_t kWorks = static_cast<size_t>(MapWork::kCull) + 1;

  mutable std::mutex mutex_;
  Histogram waited_ms_;
  Histogram judged_ms_;
  Histogram published_ms_;
  Histogram searchable_ms_;
  Histogram overlaps_ms_;
  std::array<Histogram, kWorks> work_ms_;       ///< by MapWork
  std::array<Histogram, kWorks> observations_;  ///< of adjustments, by MapWork
};

}  // namespace cairn
