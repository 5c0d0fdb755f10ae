// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <vector>

#include "common/io/trajectory.h"
#include "server/mapping/map_record.h"
#include "server/relocalization/place_index.h"

/// Maps of recordings kept between runs, so that a change of the relocalizer can be measured on the same maps
/// without making them again.
namespace cairn {

struct KeptMap {
  IndexedMapPtr map;               ///< indexed anew, by the present code
  std::vector<StampedPose> poses;  ///< map_from_camera, that the tracker or the map maker gave
};

/// Keeps a map as folder/NAME.cairn, a map file, and `poses` as folder/NAME.txt, a trajectory. Replaces what
/// is there.
[[nodiscard]] Status keep_map(const std::filesystem::path& folder, const std::string& name, const MapId& map,
                              const MapRecord& record, const std::vector<StampedPose>& poses);

/// Reads a map that keep_map() has kept. Error kNotFound: it was never kept there.
[[nodiscard]] Result<KeptMap> read_kept_map(const std::filesystem::path& folder, const std::string& name,
                                            const MapId& map);

}  // namespace cairn
