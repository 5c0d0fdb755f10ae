// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace cairn {

/// A frame is on time when its pose is there this long after it fell due [ms]: one period of 30 Hz.
inline constexpr double kOnTimeMs = 33.0;

}  // namespace cairn
