// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"

/// Which recordings are asked about, and how each is mapped: a text file, whose rows places/places.txt
/// explains.
namespace cairn {

/// A row of the list.
struct ListedPlace {
  enum class Kind : uint8_t { kVideo, kStills, kUnmapped };
  Kind kind = Kind::kUnmapped;
  std::string name = {};        ///< the recording's folder in the folder of recordings
  std::string camera = {};      ///< calibration in that folder or beside the list; empty: the recording's own
  std::string truth = {};       ///< trajectory in that folder; empty: none
  bool asks_elsewhere = false;  ///< what is asked about does not show what is mapped
  bool is_metric = false;       ///< the truth is in metres
  size_t mapped_frames = 0;     ///< of a video, from its first
};

/// Errors: kConfiguration, with `name` and the line.
[[nodiscard]] Result<std::vector<ListedPlace>> parse_places(std::string_view content,
                                                            const std::filesystem::path& name);

/// The files of a place.
struct PlaceFiles {
  std::string source;       ///< as open_source() takes it
  std::string camera = {};  ///< empty: the recording's own
  std::string truth = {};   ///< empty: none
};
/// Finds the files of a place in `recordings`, its camera also in `beside`, the folder of the list. Errors
/// name what is missing: kNotFound.
[[nodiscard]] Result<PlaceFiles> find_files(const ListedPlace& place, const std::filesystem::path& recordings,
                                            const std::filesystem::path& beside);

}  // namespace cairn
