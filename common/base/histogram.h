// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/base/reset_on_move.h"

namespace cairn {

/// Percentiles of a stream in bounded memory: counts in cells 1 % wide, so that a percentile is right to half
/// a per cent. For positive numbers from 1e-3 to 1e7 (times in ms); others count as the nearest of these.
class Histogram {
 public:
  void add(double value);
  [[nodiscard]] size_t count() const { return count_; }
  /// The percentile by nearest rank: the least value that a share `p` (0..1) of all values does not exceed; 0
  /// where there are no values.
  [[nodiscard]] double percentile(double p) const;

 private:
  std::vector<uint64_t> cells_;
  ResetOnMove<size_t> count_;
  double least_ = 0;
  double greatest_ = 0;
};

}  // namespace cairn
