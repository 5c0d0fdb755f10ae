// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/mapping/map_state.h"

namespace cairn {

/// Turns a map so that its z is up, by what the keyframe measured of gravity; how it is turned about z stays
/// nearest to what it was. Nothing happens where the keyframe does not know. A map that lies on its plane
/// does not need it.
void stand_upright(KeyframeId knows_up, MapState* map);

}  // namespace cairn
