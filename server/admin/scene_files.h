// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string_view>

#include "common/base/result.h"
#include "server/admin/exported_scene.h"

/// Maps in the formats of other programs. Each makes the folder it is given; errors are kIo, and name the
/// file.
namespace cairn {

/// COLMAP's sparse model as text (cameras.txt, images.txt, points3D.txt) or binary (.bin), and the images
/// in `images/` beside. A camera without distortion is a PINHOLE. COLMAP's pixels are half a pixel more than
/// ours, its quaternions have w first.
[[nodiscard]] Status write_colmap_text(const ExportedScene& scene, const std::filesystem::path& folder);
[[nodiscard]] Status write_colmap_binary(const ExportedScene& scene, const std::filesystem::path& folder);
[[nodiscard]] Status write_images(const ExportedScene& scene, const std::filesystem::path& folder);
/// A line in the header of each of our PLY files.
inline constexpr std::string_view kPlyComment = "comment frame and unit of the map";
/// Points with normals and grey values as binary PLY.
[[nodiscard]] Status write_ply(const ExportedScene& scene, const std::filesystem::path& file);

}  // namespace cairn
