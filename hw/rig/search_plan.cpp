// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/search_plan.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace cairn {
namespace {

constexpr double kBeforeOthers = 1e3;  // of one criterion over the next: no option, it only sorts

double angle(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

/// How many views it takes to cover the angle `round` [rad] with an overlap; 1 at least.
int count(double round, double view, const SearchPlanOptions& options) {
  return std::max(
      1, static_cast<int>(std::ceil(round / std::max(options.least_step, options.view_step * view) - 1e-9)));
}

}  // namespace

SearchPlan::SearchPlan(const pointing::Search& search, const Eigen::Vector3d& begin,
                       const SearchPlanOptions& options)
    : pattern_(search.pattern), view_(search.view) {
  const PanTilt middle = look_along(begin);
  const int rows = count(std::numbers::pi / 2, search.view.tilt, options);  // above the horizon, and below
  step_ = std::numbers::pi / 2 / rows;
  for (int row = -rows; row <= rows; ++row) {
    const double tilt = row * step_;
    const int columns = count(2 * std::numbers::pi * std::cos(tilt), search.view.pan, options);
    for (int column = 0; column < columns; ++column) {
      const double pan = middle.pan + 2 * std::numbers::pi * column / columns;
      const int aside = std::min(column, columns - column);
      const int above = std::abs(row - static_cast<int>(std::lround(middle.tilt / step_)));
      // Who turns away does so about the vertical: what was there is as high as it was. Beyond its neighbours
      // one side is looked at after the other, for to and fro is most of the way.
      places_.push_back({optical_axis({pan, tilt}), row, 3 * above + std::min(aside, 2)});
    }
  }
  rank(search.ranked);
}

SearchPlan::Place& SearchPlan::nearest(const Eigen::Vector3d& direction) {
  return *std::min_element(places_.begin(), places_.end(), [&](const Place& a, const Place& b) {
    return angle(a.direction, direction) < angle(b.direction, direction);
  });
}

bool SearchPlan::is_for(const pointing::Search& search) const {
  return search.pattern == pattern_ && search.view.pan == view_.pan && search.view.tilt == view_.tilt;
}

void SearchPlan::rank(const std::vector<Eigen::Vector3d>& ranked) {
  std::vector<size_t> known;
  for (size_t i = 0; i < places_.size(); ++i) {
    if (std::exchange(places_[i].rank, static_cast<int>(ranked.size())) < ranked_) known.push_back(i);
  }
  ranked_ = static_cast<int>(ranked.size());
  for (int i = ranked_; i-- > 0;) nearest(ranked[static_cast<size_t>(i)]).rank = i;
  // A map was seen since where none was ranked.
  for (size_t i = 0; i < places_.size(); ++i) {
    if (places_[i].rank < ranked_ && std::find(known.begin(), known.end(), i) == known.end())
      places_[i].looked = false;
  }
}

void SearchPlan::look(const Eigen::Vector3d& direction) {
  nearest(direction).looked = true;
}

double SearchPlan::cost(const Place& place, const Eigen::Vector3d& from) const {
  const double along = pattern_ == pointing::Search::Pattern::kSpiral
                           ? place.ring
                           : std::abs(place.row - std::round(look_along(from).tilt / step_));
  return (place.rank * kBeforeOthers + along) * kBeforeOthers + angle(place.direction, from);
}

std::optional<Eigen::Vector3d> SearchPlan::next(const Eigen::Vector3d& from, const Reach& within_reach) {
  std::vector<Place*> reached;
  for (Place& place : places_) {
    if (within_reach(place.direction)) reached.push_back(&place);
  }
  if (reached.empty()) return std::nullopt;
  if (std::all_of(reached.begin(), reached.end(), [](const Place* place) { return place->looked; })) {
    for (Place* place : reached) place->looked = false;
    ++rounds_;
  }
  const Place* best = nullptr;
  for (const Place* place : reached) {
    if (!place->looked && (best == nullptr || cost(*place, from) < cost(*best, from))) best = place;
  }
  return best->direction;
}

double SearchPlan::looked_at(const Reach& within_reach) const {
  int reached = 0;
  int looked = 0;
  for (const Place& place : places_) {
    if (!within_reach(place.direction)) continue;
    ++reached;
    looked += place.looked ? 1 : 0;
  }
  return reached == 0 ? 1 : static_cast<double>(looked) / reached;
}

}  // namespace cairn
