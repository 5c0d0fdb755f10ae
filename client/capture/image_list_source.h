// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "client/capture/frame_source.h"
#include "client/capture/source_uri.h"

namespace cairn {

[[nodiscard]] Result<std::unique_ptr<FrameSource>> open_tum_source(const SourceUri& uri);
[[nodiscard]] Result<std::unique_ptr<FrameSource>> open_euroc_source(const SourceUri& uri);
[[nodiscard]] Result<std::unique_ptr<FrameSource>> open_images_source(const SourceUri& uri);

/// The camera's folder of an `euroc:` source, which holds data.csv, data/ and sensor.yaml.
[[nodiscard]] std::filesystem::path euroc_camera_folder(const SourceUri& uri);

}  // namespace cairn
