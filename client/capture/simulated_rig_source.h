// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "client/capture/frame_source.h"
#include "client/capture/source_uri.h"

namespace cairn {

/// `sim:SCENARIO?rig=PATH`: live, what the camera of a simulated rig sees from where `cairn-rig simulate
/// --camera PATH` has it, by that one's clock. Errors besides those of the simulator: kUsage for options of
/// how the camera is moved and covered, kNotFound (no rig there). An error when nothing comes for 2 s; the
/// end when the rig has ended.
[[nodiscard]] Result<std::unique_ptr<FrameSource>> open_simulated_rig_source(const SourceUri& uri);

}  // namespace cairn
