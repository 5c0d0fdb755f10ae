// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

/// What a map maker and the wire must agree on.
namespace cairn {

/// Point blocks in a map: 131 072 points ever made, removed ones included.
inline constexpr size_t kMaxBlocks = 2048;
/// Keyframe blocks in a map: 32 768 keyframes ever made, removed ones included. Fewer than point blocks, so
/// that the commit of the largest map stays below 64 kB.
inline constexpr size_t kMaxKeyframeBlocks = 512;

/// Of a two-view start: the answer names a point for each, and stays below 64 kB.
inline constexpr size_t kMaxTrails = 4000;

/// Corners without a point of the map that come with an offered keyframe.
inline constexpr size_t kMaxCandidates = 256;

/// Cameras that are self-calibrated in a map and named by its revisions; more are not told.
inline constexpr size_t kMaxCalibratedCameras = 64;

}  // namespace cairn
