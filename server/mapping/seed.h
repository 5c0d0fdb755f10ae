// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/mapping/adjustment.h"
#include "server/mapping/map_maker.h"
#include "server/mapping/map_state.h"

/// The two-view start (PTAM 2007, 6.1): the tracker says how the camera moved, which it has judged by more
/// views than these two; here its word is checked on measurements made anew.
namespace cairn {

struct SeededMap {
  MapState map;
  SeedResult result;
};

/// Makes a map of two keyframes and their points, adjusted, scaled to the baseline and turned to the dominant
/// plane; or says why not, for a person (kDegenerate for geometry, kDamaged for input that is no pair of
/// views, kRefused for a map outside of its extent).
[[nodiscard]] Result<SeededMap> seed_map(const SeedInput& input, const MapMakerOptions& options);

}  // namespace cairn
