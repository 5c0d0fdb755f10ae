// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/world/random.h"
#include "tests/world/world_builder.h"

namespace cairn {

/// What a room is lined with. The regions are repeated over their surfaces.
struct RoomSurfaces {
  TextureRegion floor;    ///< a metre square
  TextureRegion wall;     ///< the whole wall's height, two metres of its length
  TextureRegion ceiling;  ///< a tile of 0.6 m
};

/// Carpet, plaster and ceiling tiles.
[[nodiscard]] RoomSurfaces make_surfaces(Random& random, WorldBuilder* world);

/// The inside of a box, as one who stands in it sees it, from the low to the high corner; in the frame of the
/// builder.
void add_room(const Eigen::Vector3d& low, const Eigen::Vector3d& high, const RoomSurfaces& surfaces,
              WorldBuilder* world);

/// Plaster, nearly white.
[[nodiscard]] Bitmap plaster(int size, Random& random);

}  // namespace cairn
