// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/pointing.h"

namespace cairn {
namespace {

struct DemandsOf {
  const BaseMotion& base;
  double ahead;
  double pan;

  std::array<Demand, 2> operator()(const pointing::Neutral& neutral) const {
    return {Demand{neutral.angles.pan, 0}, Demand{neutral.angles.tilt, 0}};
  }
  std::array<Demand, 2> operator()(const pointing::Jog& jog) const {
    return {Demand{std::nullopt, jog.rates.pan}, Demand{std::nullopt, jog.rates.tilt}};
  }
  std::array<Demand, 2> operator()(const pointing::Lock& lock) const {
    if (!base.is_known() || !lock.direction) return {};
    const Eigen::Vector3d direction = base.world_from_base(ahead).conjugate() * *lock.direction;
    const PanTilt angles = look_along(direction, pan);
    const PanTilt rates = rates_to_hold(direction, base.rate(ahead));
    return {Demand{angles.pan, rates.pan}, Demand{angles.tilt, rates.tilt}};
  }
};

}  // namespace

std::array<Demand, 2> demands_of(const Pointing& pointing, const BaseMotion& base, double ahead, double pan) {
  return std::visit(DemandsOf{base, ahead, pan}, pointing);
}

}  // namespace cairn
