// SPDX-License-Identifier: Apache-2.0
#include "server/service/work_times.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "common/io/json_text.h"

namespace cairn {
namespace {

using Json = nlohmann::ordered_json;

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

Json summary(const Histogram& values) {
  const auto at = [&values](double p) { return std::round(values.percentile(p) * 1e3) / 1e3; };
  return {{"count", values.count()}, {"p50", at(0.50)}, {"p95", at(0.95)}, {"p99", at(0.99)}, {"max", at(1)}};
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

std::string WorkTimes::to_json() const {
  const std::scoped_lock lock(mutex_);
  Json json{{"offer_waited_ms", summary(waited_ms_)},
            {"offer_judged_cpu_ms", summary(judged_ms_)},
            {"offer_to_points_ms", summary(published_ms_)},
            {"offer_to_searchable_ms", summary(searchable_ms_)},
            {"overlap_check_cpu_ms", summary(overlaps_ms_)}};
  for (size_t work = static_cast<size_t>(MapWork::kNewPoints); work < kWorks; ++work) {
    const std::string name = to_string(static_cast<MapWork>(work));
    json[name + "_cpu_ms"] = summary(work_ms_[work]);
    if (observations_[work].count() > 0) json[name + "_observations"] = summary(observations_[work]);
  }
  return json_text(json, 1) + "\n";
}

}  // namespace cairn
