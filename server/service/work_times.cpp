// SPDX-License-Identifier: Apache-2.0
#include "server/service/work_times.h"

#include <cmath>
#include <utility>

namespace cairn {
namespace {

const char* to_string(MapWork work) {
  switch (work) {
    case MapWork::kNewPoints:
      return "new_points";
    case MapWork::kLocalAdjustment:
      return "local_adjustment";
    case MapWork::kRefind:
      return "refind";
    case MapWork::kGlobalAdjustment:
      return "global_adjustment";
    case MapWork::kCull:
      return "cull";
    case MapWork::kNone:
      break;
  }
  return "none";
}

double to_ms(std::chrono::nanoseconds duration) {
  return std::chrono::duration<double, std::milli>(duration).count();
}

WorkSummary summary(std::string name, const Histogram& values) {
  const auto at = [&values](double p) { return std::round(values.percentile(p) * 1e3) / 1e3; };
  return {std::move(name), values.count(), at(0.50), at(0.95), at(0.99), at(1)};
}

}  // namespace

void WorkTimes::waited(std::chrono::nanoseconds wall) {
  const std::scoped_lock lock(mutex_);
  waited_ms_.add(to_ms(wall));
}

void WorkTimes::judged(std::chrono::nanoseconds cpu) {
  const std::scoped_lock lock(mutex_);
  judged_ms_.add(to_ms(cpu));
}

void WorkTimes::worked(const StepReport& report, std::chrono::nanoseconds cpu) {
  const auto work = static_cast<size_t>(report.work);
  const std::scoped_lock lock(mutex_);
  work_ms_[work].add(to_ms(cpu));
  if (report.observations > 0) observations_[work].add(report.observations);
}

void WorkTimes::points_published(std::chrono::nanoseconds wall) {
  const std::scoped_lock lock(mutex_);
  published_ms_.add(to_ms(wall));
}

void WorkTimes::searchable(std::chrono::nanoseconds wall) {
  const std::scoped_lock lock(mutex_);
  searchable_ms_.add(to_ms(wall));
}

void WorkTimes::checked_for_overlaps(std::chrono::nanoseconds cpu) {
  const std::scoped_lock lock(mutex_);
  overlaps_ms_.add(to_ms(cpu));
}

std::vector<WorkSummary> WorkTimes::summaries() const {
  const std::scoped_lock lock(mutex_);
  std::vector<WorkSummary> all{
      summary("offer_waited_ms", waited_ms_), summary("offer_judged_cpu_ms", judged_ms_),
      summary("offer_to_points_ms", published_ms_), summary("offer_to_searchable_ms", searchable_ms_),
      summary("overlap_check_cpu_ms", overlaps_ms_)};
  for (size_t work = static_cast<size_t>(MapWork::kNewPoints); work < kWorks; ++work) {
    const std::string name = to_string(static_cast<MapWork>(work));
    all.push_back(summary(name + "_cpu_ms", work_ms_[work]));
    if (observations_[work].count() > 0) all.push_back(summary(name + "_observations", observations_[work]));
  }
  return all;
}

}  // namespace cairn
