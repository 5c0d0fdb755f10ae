// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "common/image/image.h"
#include "server/relocalization/place_index.h"
#include "tests/bench/places_list.h"
#include "tests/bench/truth.h"

/// Recordings made into maps, and the images of them that were not mapped.
namespace cairn {

struct Query {
  uint64_t frame = 0;
  GrayImagePtr image;
  std::optional<SE3> exact;  ///< truth_from_camera
};

/// A recording, mapped or not.
struct Place {
  std::string name;
  std::string how;  ///< it was mapped
  CameraPtr camera;
  IndexedMapPtr map = {};  ///< null: none
  Similarity3 truth_from_map = {};
  double depth = 0;                                        ///< mean of its keyframes [of the truth]
  double reach = std::numeric_limits<double>::infinity();  ///< of a mapped view [of the truth]
  std::vector<SE3> mapped = {};                            ///< views, truth_from_camera
  std::vector<Query> queries = {};
  bool asks_elsewhere = false;  ///< without truth: the queries do not show what is mapped
};

struct Places {
  std::vector<Place> made;
  std::vector<std::string> left_out;  ///< names of those that could not be mapped or measured
};

struct PlacesOptions {
  std::filesystem::path recordings;  ///< folder of the recordings' folders
  std::filesystem::path list;        ///< which of them
  std::filesystem::path keep;        ///< folder of maps made before; empty: none are kept
  uint64_t seed = 1;                 ///< of every random choice
};

/// One map after the other, in minutes; stderr tells of each, and why one is left out. Errors: a list that
/// cannot be read, no folder of recordings, nothing of the list in it.
[[nodiscard]] Result<Places> make_places(const PlacesOptions& options);

}  // namespace cairn
