// SPDX-License-Identifier: Apache-2.0
#include "common/image/smear.h"

#include <algorithm>
#include <cmath>

#include "common/image/pyramid.h"

namespace cairn {

Smear::Smear(const TinyMotion& motion, float share, int width, int height) {
  constexpr auto kScale = static_cast<float>(1 << kPyramidLevels);  // the small image is level 3 halved again
  if (!std::isfinite(motion.score)) return;
  is_none_ = false;
  center_ = {(static_cast<float>(width) - 1) / 2, (static_cast<float>(height) - 1) / 2};
  shift_ = share * kScale * motion.shift;
  angle_ = share * motion.angle;
}

Eigen::Vector2f missing_smear(const Eigen::Vector2f& wanted, const Eigen::Vector2f& has) {
  const float squared = wanted.squaredNorm();
  if (!(squared > 0)) return wanted;
  const float along = has.dot(wanted) / squared;
  return std::sqrt(std::max(0.0F, 1 - along * along)) * wanted;
}

}  // namespace cairn
