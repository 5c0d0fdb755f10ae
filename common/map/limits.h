// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

/// Limits on which the map maker, the wire and the store must agree.
namespace cairn {

/// Points or keyframes per block; a patch block stays below 64 kB on the wire.
inline constexpr int kBlockSlots = 64;

/// Point blocks in a map, and points ever made in it, removed ones included: 131 072.
inline constexpr size_t kMaxBlocks = 2048;
inline constexpr size_t kMaxPoints = kMaxBlocks * kBlockSlots;
/// Keyframe blocks in a map, and keyframes ever made in it, removed ones included: 32 768. Fewer than points,
/// so that the commit of the largest map stays below 64 kB.
inline constexpr size_t kMaxKeyframeBlocks = 512;
inline constexpr size_t kMaxKeyframes = kMaxKeyframeBlocks * kBlockSlots;

/// [bytes] Longest name of a map.
inline constexpr size_t kMaxNameBytes = 128;

/// Most trails of a two-view start: the answer names a point for each, and stays below 64 kB.
inline constexpr size_t kMaxTrails = 4000;

/// Most points of a map found in a frame.
inline constexpr size_t kMaxMeasurements = 8192;

/// Most corners without a point of the map that come with an offered keyframe.
inline constexpr size_t kMaxCandidates = 256;

/// Most cameras that are self-calibrated in a map and named by its revisions; more are not told.
inline constexpr size_t kMaxCalibratedCameras = 64;

/// [map unit] Largest coordinate or distance.
inline constexpr double kMaxLength = 1e6;

/// [ns] Largest time before or after the epoch, of any camera's clock: differences of two never overflow. 146
/// years.
inline constexpr int64_t kMaxTime = int64_t{1} << 62;

/// How much the norm of a quaternion or direction may differ from 1: as double, and as float.
inline constexpr double kUnitTolerance = 1e-6;
inline constexpr float kUnitToleranceFloat = 1e-3F;

}  // namespace cairn
