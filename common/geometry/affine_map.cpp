// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/affine_map.h"

#include <Eigen/LU>
#include <algorithm>
#include <numeric>
#include <optional>
#include <vector>

namespace cairn {
namespace {

struct AffineFit {
  Eigen::Matrix2d linear;
  Eigen::Vector2d from;  ///< centre of the matches in the first view
  Eigen::Vector2d to;    ///< and in the second
};

std::optional<AffineFit> fit(std::span<const PixelMatch> matches, std::span<const size_t> used) {
  AffineFit f{Eigen::Matrix2d::Zero(), Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero()};
  for (const size_t i : used) {
    f.from += matches[i].a / static_cast<double>(used.size());
    f.to += matches[i].b / static_cast<double>(used.size());
  }
  Eigen::Matrix2d cross = Eigen::Matrix2d::Zero();
  Eigen::Matrix2d square = Eigen::Matrix2d::Zero();
  for (const size_t i : used) {
    const Eigen::Vector2d from = matches[i].a - f.from;
    cross += (matches[i].b - f.to) * from.transpose();
    square += from * from.transpose();
  }
  constexpr double kOnALine = 1e-9;  ///< of the square of the spread
  const bool spread = square.determinant() > kOnALine * square.trace() * square.trace();
  if (!spread) return std::nullopt;
  f.linear = cross * square.inverse();
  return f;
}

}  // namespace

Eigen::Matrix2d fit_affine_map(std::span<const PixelMatch> matches) {
  constexpr size_t kFewest = 6;
  constexpr int kRounds = 3;
  if (matches.size() < kFewest) return Eigen::Matrix2d::Identity();
  std::vector<size_t> order(matches.size());
  std::iota(order.begin(), order.end(), size_t{0});
  size_t used = order.size();
  Eigen::Matrix2d linear = Eigen::Matrix2d::Identity();
  for (int round = 0; round < kRounds; ++round) {
    const auto best = fit(matches, std::span(order).first(used));
    if (!best || !best->linear.allFinite()) return Eigen::Matrix2d::Identity();
    linear = best->linear;
    if (round + 1 == kRounds) break;
    const auto error = [&](size_t i) {
      return (matches[i].b - best->to - best->linear * (matches[i].a - best->from)).squaredNorm();
    };
    used = order.size() * 2 / 3;
    std::nth_element(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(used), order.end(),
                     [&error](size_t i, size_t k) { return error(i) < error(k); });
  }
  return linear;
}

}  // namespace cairn
