// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

#include "hw/rig/kinematics.h"
#include "hw/rig/pointing.h"
#include "hw/rig/rig_tuning.h"

namespace cairn {

/// Plans where to look next: the world's directions as places a view apart, of which those within reach are
/// looked at, each once before any twice: ranked ones first; then, as a spiral, those beside where it began,
/// all that are as high, and those above and below; or in rows. Pure.
class SearchPlan {
 public:
  using Reach = std::function<bool(const Eigen::Vector3d&)>;

  /// Plans a search from a camera that looks in direction `begin`.
  SearchPlan(const pointing::Search& search, const Eigen::Vector3d& begin, const SearchPlanOptions& options);

  /// Whether it was made for such a search; its ranking may differ.
  [[nodiscard]] bool is_for(const pointing::Search& search) const;
  /// The next direction, of length 1; nothing where nothing is within reach. `from`: where the camera looks.
  [[nodiscard]] std::optional<Eigen::Vector3d> next(const Eigen::Vector3d& from, const Reach& within_reach);
  /// The place in this direction was looked at.
  void look(const Eigen::Vector3d& direction);
  /// New places to begin with, also where they were looked at; else what was looked at stays known.
  void rank(const std::vector<Eigen::Vector3d>& ranked);
  /// How often all that was within reach had been looked at.
  [[nodiscard]] int rounds() const { return rounds_; }
  /// Share of the places within reach that were looked at in the present round.
  [[nodiscard]] double looked_at(const Reach& within_reach) const;

 private:
  struct Place {
    Eigen::Vector3d direction;
    int row;
    int ring;  ///< the further out, the later
    bool looked = false;
    int rank = 0;
  };
  [[nodiscard]] Place& nearest(const Eigen::Vector3d& direction);
  [[nodiscard]] double cost(const Place& place, const Eigen::Vector3d& from) const;

  pointing::Search::Pattern pattern_;
  PanTilt view_;
  double step_;  ///< [rad] between rows
  std::vector<Place> places_;
  int ranked_ = 0;  ///< so many
  int rounds_ = 0;
};

}  // namespace cairn
