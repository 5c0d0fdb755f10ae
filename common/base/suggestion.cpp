// SPDX-License-Identifier: Apache-2.0
#include "common/base/suggestion.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace cairn {
namespace {

size_t levenshtein_distance(std::string_view a, std::string_view b) {
  std::vector<size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), size_t{0});
  for (size_t i = 0; i < a.size(); ++i) {
    size_t diagonal = std::exchange(row[0], i + 1);
    for (size_t j = 0; j < b.size(); ++j) {
      const size_t replaced = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j] + 1, diagonal + 1});
    }
  }
  return row.back();
}

}  // namespace

std::string did_you_mean(std::string_view word, const std::vector<std::string>& valid) {
  const std::string* nearest = nullptr;
  size_t least = word.size() / 2 + 1;
  for (const std::string& candidate : valid) {
    const size_t distance = levenshtein_distance(word, candidate);
    if (distance >= least) continue;
    least = distance;
    nearest = &candidate;
  }
  return nearest == nullptr ? "" : "; did you mean " + *nearest + "?";
}

}  // namespace cairn
