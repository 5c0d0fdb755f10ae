// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "tests/world/projected_face.h"
#include "tests/world/scenario.h"

namespace cairn {

/// The nearest face along a ray.
struct Sight {
  int place = -1;    ///< index into Scenario::places, -1 none
  double depth = 0;  ///< [m] along the camera's axis
};

/// Finds what a scenario's camera sees: along one ray, or of each place, on a grid of rays through evenly
/// spread pixels. The scenario must outlive it. Const calls are thread-safe.
class Census {
 public:
  explicit Census(const Scenario& scenario);

  struct Survey {
    std::vector<double> shares;  ///< of the image (0 to 1), that each place fills
    double depth = 0;            ///< [m], the median along the camera's axis; 0 where no face is
  };
  /// Surveys the whole image, seen with the poses of all bodies.
  [[nodiscard]] Survey survey(std::span<const ViewMatrix> camera_from_body) const;
  /// What is seen along a ray, given by its point in the plane z = 1; nothing where no face is.
  [[nodiscard]] std::optional<Sight> look(std::span<const ViewMatrix> camera_from_body,
                                          const Eigen::Vector2d& ray) const;

 private:
  struct Hit {
    float inverse_depth = 0;  ///< [1/m], 0: no face
    int place = -1;
  };
  /// The nearest face along each ray; `view` is a box about the rays.
  [[nodiscard]] std::vector<Hit> cast(std::span<const ViewMatrix> camera_from_body,
                                      std::span<const Eigen::Vector2f> rays, const IdealBox& view) const;

  const Scenario& scenario_;
  std::vector<FaceCluster> clusters_;
  std::vector<Eigen::Vector2f> rays_;  ///< in the plane z = 1
  IdealBox view_;
};

}  // namespace cairn
