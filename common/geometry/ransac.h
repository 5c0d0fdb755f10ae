// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>

#include "common/geometry/sampling.h"

namespace cairn {

/// Cost of a model in MSAC (Torr and Zisserman 2000): the residuals of all items, each at most `cutoff`.
/// `residual(item)` is squared or absolute, as the cut-off is. Stops counting where the sum reaches `limit`.
template <typename Items, typename Residual>
[[nodiscard]] double truncated_cost(const Items& items, double cutoff, double limit, Residual residual) {
  double cost = 0;
  for (const auto& item : items) {
    cost += std::min(residual(item), cutoff);
    if (cost >= limit) break;
  }
  return cost;
}

struct RansacOptions {
  size_t population = 0;    ///< items that samples are drawn from, at least as many as a sample has
  double all_outliers = 0;  ///< cost of a model that no item agrees with: cut-off times population
  int most_trials = 0;
  bool stops_early = true;  ///< once a sample of inliers has been drawn with probability 0.999
  uint64_t seed = 0;
};

template <typename Model>
struct Hypothesis {
  Model model;
  double cost = 0;
};

/// RANSAC (Fischler and Bolles 1981): the cheapest model of all trials, nothing if none costs less than that
/// all items are outliers. `propose(sample, limit)` makes what the `N` indices of a sample say a
/// std::optional<Hypothesis<Model>>: their best model if it costs less than `limit`, refined by its inliers
/// if that pays (Chum, Matas and Kittler 2003). The same bytes for a seed on every platform.
template <size_t N, typename Model, typename Propose>
[[nodiscard]] std::optional<Model> ransac(const RansacOptions& options, Propose propose) {
  MinimalSampler sampler(options.seed, options.population);
  std::optional<Model> best;
  double cost = options.all_outliers;
  int trials = options.most_trials;
  for (int trial = 0; trial < trials; ++trial) {
    std::optional<Hypothesis<Model>> found = propose(sampler.draw<N>(), cost);
    if (!found) continue;
    best = std::move(found->model);
    cost = found->cost;
    if (!options.stops_early) continue;
    const double inlier_fraction = 1 - cost / options.all_outliers;
    trials = std::min(trials, required_trials(inlier_fraction, static_cast<int>(N), options.most_trials));
  }
  return best;
}

}  // namespace cairn
