// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace cairn::wire {

/// [bytes] Of why something is refused. Who receives a longer one does not take the message.
inline constexpr size_t kMaxReasonBytes = 1024;

/// Decisions on the latest commands that a verdict repeats.
inline constexpr size_t kMaxOutcomes = 16;

/// Parameters of a camera, whatever its model.
inline constexpr size_t kMaxCameraValues = 32;

/// Commands that a writer keeps for repetition. More than any credit, so none is overwritten unacknowledged;
/// bounded, so that a writer never waits for a dead server (a KEEP_ALL writer blocks at the high-water mark
/// until the lease is over, measured).
inline constexpr size_t kCommandDepth = 32;

/// Corners in a relocalization query, and candidates in its answer.
inline constexpr size_t kMaxPlaceCorners = 1024;
inline constexpr size_t kMaxPlaceCandidates = 16;

}  // namespace cairn::wire
