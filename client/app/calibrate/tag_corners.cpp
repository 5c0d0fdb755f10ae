// SPDX-License-Identifier: Apache-2.0
#include "client/app/calibrate/tag_corners.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "common/base/median.h"

namespace cairn {
namespace {

constexpr double kStep = 0.5;           ///< [px] along a profile
constexpr double kInset = 0.1;          ///< of a side at each end: there blur mixes it with its neighbour
constexpr double kLeastContrast = 8;    ///< [grey values per px] of an edge
constexpr double kMostHalfWidth = 2.5;  ///< [px] of an edge: further off, noise only
constexpr std::array kMostReach = {3.0, 2.0, 1.0};  ///< [px] from where the side was, pass by pass

/// The point at which an edge crosses a profile.
struct Crossing {
  double along = 0;   ///< share of the side
  double across = 0;  ///< [px] outwards from the chord
};

std::optional<double> brightness(const GrayView& image, const Eigen::Vector2d& at) {
  const auto x = static_cast<int>(std::floor(at.x()));
  const auto y = static_cast<int>(std::floor(at.y()));
  if (x < 0 || y < 0 || x + 1 >= image.width || y + 1 >= image.height) return std::nullopt;
  const double fx = at.x() - x;
  const double fy = at.y() - y;
  const uint8_t* upper = image.row(y) + x;
  const uint8_t* lower = image.row(y + 1) + x;
  return (1 - fy) * ((1 - fx) * upper[0] + fx * upper[1]) + fy * ((1 - fx) * lower[0] + fx * lower[1]);
}

/// The centroid of the strongest rise of brightness: unlike its peak it does not favour whole pixels.
std::optional<double> find_edge(const GrayView& image, const Eigen::Vector2d& from,
                                const Eigen::Vector2d& outward, double reach, double half_width) {
  const int ends = static_cast<int>(std::ceil((reach + half_width) / kStep)) + 1;
  std::vector<double> values;
  for (int i = -ends; i <= ends; ++i) {
    const auto value = brightness(image, from + i * kStep * outward);
    if (!value) return std::nullopt;
    values.push_back(*value);
  }
  const auto rise = [&](int i) {  // over a pixel
    const auto at = static_cast<size_t>(i + ends);
    return std::max(0.0, values[at + 1] - values[at - 1]);
  };
  int strongest = 0;
  for (int i = 1 - ends; i < ends; ++i) {
    if (std::abs(i * kStep) <= reach && rise(i) > rise(strongest)) strongest = i;
  }
  if (rise(strongest) < kLeastContrast) return std::nullopt;
  double centre = strongest * kStep;
  for (int round = 0; round < 2; ++round) {
    double sum = 0;
    double moment = 0;
    for (int i = 1 - ends; i < ends; ++i) {
      if (std::abs(i * kStep - centre) > half_width) continue;
      sum += rise(i);
      moment += rise(i) * i * kStep;
    }
    if (!(sum > 0)) return std::nullopt;
    centre = moment / sum;
  }
  return centre;
}

/// Least squares by a polynomial without what lies 2.5 deviations off; its values at both ends of the side.
std::optional<Eigen::Vector2d> fit(const std::vector<Crossing>& crossings, int degree, size_t fewest) {
  constexpr int kRounds = 4;
  constexpr double kFurthest = 2.5;
  constexpr double kLeastDeviation = 0.05;  // [px]
  std::vector<Crossing> kept = crossings;
  Eigen::VectorXd factors;
  for (int round = 0; round < kRounds; ++round) {
    if (kept.size() < fewest) return std::nullopt;
    Eigen::MatrixXd powers(kept.size(), degree + 1);
    Eigen::VectorXd values(kept.size());
    for (Eigen::Index i = 0; i < values.size(); ++i) {
      const Crossing& crossing = kept[static_cast<size_t>(i)];
      for (int k = 0; k <= degree; ++k) powers(i, k) = std::pow(crossing.along, k);
      values[i] = crossing.across;
    }
    factors = powers.colPivHouseholderQr().solve(values);
    const auto error = [&](const Crossing& c) {
      double value = 0;
      for (int k = degree; k >= 0; --k) value = value * c.along + factors[k];
      return std::abs(c.across - value);
    };
    std::vector<double> errors;
    for (const Crossing& c : kept) errors.push_back(error(c));
    constexpr double kDeviationPerMedian = 1.4826;
    const double deviation =
        std::max(kLeastDeviation, kDeviationPerMedian * reorder_to_median(std::span(errors)));
    const size_t before = kept.size();
    kept.clear();
    for (const Crossing& c : crossings) {
      if (error(c) < kFurthest * deviation) kept.push_back(c);
    }
    if (kept.size() == before) break;
  }
  return Eigen::Vector2d(factors[0], factors.sum());
}

/// How far outwards of its chord the side lies at both ends [px].
std::optional<Eigen::Vector2d> fit_side(const GrayView& image, const Eigen::Vector2d& begin,
                                        const Eigen::Vector2d& end, const Eigen::Vector2d& outward,
                                        double reach, double half_width, int degree) {
  constexpr int kFewestProfiles = 6;
  const double length = (end - begin).norm();
  const int profiles = std::max(kFewestProfiles, static_cast<int>(length * (1 - 2 * kInset)));
  std::vector<Crossing> crossings;
  for (int i = 0; i < profiles; ++i) {
    const double along = kInset + (1 - 2 * kInset) * i / (profiles - 1);
    const Eigen::Vector2d from = begin + along * (end - begin);
    if (const auto edge = find_edge(image, from, outward, reach, half_width))
      crossings.push_back({along, *edge});
  }
  return fit(crossings, degree, static_cast<size_t>(std::max(degree + 2, profiles / 2)));
}

/// Refines the corners in one pass; false where a side is not seen, or nearly goes on with the next.
bool improve(const GrayView& image, double reach, double half_width, int degree, TagCorners* corners) {
  const Eigen::Vector2d centre = ((*corners)[0] + (*corners)[1] + (*corners)[2] + (*corners)[3]) / 4;
  std::array<Eigen::Vector2d, 4> outward;
  std::array<Eigen::Vector2d, 4> off;
  for (size_t k = 0; k < 4; ++k) {
    const Eigen::Vector2d& begin = (*corners)[k];
    const Eigen::Vector2d& end = (*corners)[(k + 1) % 4];
    const Eigen::Vector2d along = (end - begin).normalized();
    outward[k] = {along.y(), -along.x()};
    if (outward[k].dot(centre - begin) > 0) outward[k] = -outward[k];
    const auto found = fit_side(image, begin, end, outward[k], reach, half_width, degree);
    if (!found) return false;
    off[k] = *found;
  }
  for (size_t k = 0; k < 4; ++k) {
    const size_t before = (k + 3) % 4;
    Eigen::Matrix2d sides;
    sides << outward[before].transpose(), outward[k].transpose();
    constexpr double kFlattest = 0.1;  // sine of the angle between two sides
    if (!(std::abs(sides.determinant()) > kFlattest)) return false;
    (*corners)[k] += sides.inverse() * Eigen::Vector2d(off[before][1], off[k][0]);
  }
  return true;
}

double shortest_side(const TagCorners& corners) {
  double shortest = (corners[3] - corners[0]).norm();
  for (size_t k = 0; k < 3; ++k) shortest = std::min(shortest, (corners[k + 1] - corners[k]).norm());
  return shortest;
}

}  // namespace

std::optional<TagCorners> refine_tag_corners(const GrayView& image, const TagCorners& corners, int modules) {
  TagCorners refined = corners;
  for (size_t pass = 0; pass < kMostReach.size(); ++pass) {
    const double module = shortest_side(refined) / modules;
    const double reach = std::min(kMostReach[pass], module);
    const double half_width = std::min(kMostHalfWidth, module);
    const int degree = pass == 0 ? 1 : 2;  // where the side is not known yet, its bend is noise
    if (!improve(image, reach, half_width, degree, &refined)) return std::nullopt;
  }
  return refined;
}

}  // namespace cairn
