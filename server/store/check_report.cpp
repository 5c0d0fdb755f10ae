// SPDX-License-Identifier: Apache-2.0
#include "server/store/check_report.h"

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace cairn {

nlohmann::json describe(const FileCheck& check) {
  constexpr size_t kMostTold = 100;
  std::vector<std::string> faults = check.faults;
  faults.insert(faults.end(), check.lost_proposals.begin(), check.lost_proposals.end());
  if (faults.size() > kMostTold) {
    const size_t more = faults.size() - kMostTold;
    faults.resize(kMostTold);
    faults.push_back("and " + std::to_string(more) + " more");
  }
  return {{"part", check.part},     {"name", check.name},     {"keyframes", check.keyframes},
          {"points", check.points}, {"labels", check.labels}, {"tags", check.tags},
          {"faults", faults},       {"remedy", check.remedy}, {"not_checked", check.not_checked}};
}

}  // namespace cairn
