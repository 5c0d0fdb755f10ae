// SPDX-License-Identifier: Apache-2.0
#include "server/service/work_times_json.h"

#include <nlohmann/json.hpp>

#include "common/io/json_text.h"

namespace cairn {

std::string to_json(const std::vector<WorkSummary>& summaries) {
  nlohmann::ordered_json json;
  for (const WorkSummary& one : summaries)
    json[one.name] = {
        {"count", one.count}, {"p50", one.p50}, {"p95", one.p95}, {"p99", one.p99}, {"max", one.max}};
  return json_text(json, 1) + "\n";
}

}  // namespace cairn
