// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "tests/world/projected_face.h"
#include "tests/world/scenario.h"

namespace cairn {

/// Counts what a scenario's camera sees of each place, on a grid of rays through evenly spread pixels. The
/// scenario must outlive it. Const calls are thread-safe.
class Census {
 public:
  explicit Census(const Scenario& scenario);

  /// Share of the picture (0 to 1) that each place fills, seen with the poses of all bodies.
  [[nodiscard]] std::vector<double> shares(std::span<const ViewMatrix> camera_from_body) const;

 private:
  const Scenario& scenario_;
  std::vector<FaceCluster> clusters_;
  std::vector<Eigen::Vector2f> rays_;  ///< in the plane z = 1
  IdealBox view_;
};

}  // namespace cairn
