// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "client/capture/frame_source.h"
#include "client/capture/source_uri.h"

namespace cairn {

[[nodiscard]] Result<std::unique_ptr<FrameSource>> open_simulated_source(const SourceUri& uri);

}  // namespace cairn
