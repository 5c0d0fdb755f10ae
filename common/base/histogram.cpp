// SPDX-License-Identifier: Apache-2.0
#include "common/base/histogram.h"

#include <algorithm>
#include <cmath>

namespace cairn {
namespace {

constexpr double kFirst = 1e-3;
constexpr double kLast = 1e7;
const double kLogStep = std::log(1.01);

}  // namespace

void Histogram::add(double value) {
  const double bounded = std::clamp(std::isfinite(value) ? value : 0.0, kFirst, kLast);
  const auto cell = static_cast<size_t>(std::log(bounded / kFirst) / kLogStep);
  if (cell >= cells_.size()) cells_.resize(cell + 1);
  ++cells_[cell];
  least_ = count_ == 0 ? value : std::min(least_, value);
  greatest_ = count_ == 0 ? value : std::max(greatest_, value);
  count_ = count_ + 1;
}

double Histogram::percentile(double p) const {
  if (count_ == 0) return 0;
  const double rank = std::max(1.0, std::ceil(std::clamp(p, 0.0, 1.0) * static_cast<double>(count_)));
  uint64_t below = 0;
  size_t cell = 0;
  while (cell + 1 < cells_.size() && static_cast<double>(below + cells_[cell]) < rank)
    below += cells_[cell++];
  const double middle = kFirst * std::exp((static_cast<double>(cell) + 0.5) * kLogStep);
  return std::clamp(middle, least_, greatest_);
}

}  // namespace cairn
