// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "client/capture/frame_source.h"
#include "common/io/trajectory.h"
#include "server/mapping/map_record.h"
#include "tests/bench/mapping_loop.h"

/// Maps made of recordings by the engines alone.
namespace cairn {

/// open_source(), which tells on stderr what it noticed.
[[nodiscard]] Result<std::unique_ptr<FrameSource>> open_aloud(const std::string& uri);

/// The camera of `file`, or, if that is empty, what `source`, opened from `uri`, knows itself, or that of the
/// file beside it. kConfiguration where it is for images of another size.
[[nodiscard]] Result<CameraPtr> choose_camera(const FrameSource& source, const std::string& uri,
                                              const std::string& file);

/// The map of the first frames of a recording, and the poses that the tracker gave meanwhile.
struct RecordedMap {
  IndexedMapPtr map;
  std::vector<StampedPose> poses;  ///< map_from_camera
  MapRecord record;                ///< of the map
};
/// Makes a map of at most `frames` frames of `source`, which goes on after them. Error kDegenerate: no map
/// came of them.
[[nodiscard]] Result<RecordedMap> map_beginning(FrameSource* source, size_t frames, const CameraPtr& camera,
                                                MapId map, uint64_t seed);

/// Maps recordings of other places, to be searched too: from all of their frames. Ids count on from `first`.
[[nodiscard]] Status map_others(const std::vector<std::string>& sources, uint8_t first, uint64_t seed,
                                PlaceIndex* index);

}  // namespace cairn
