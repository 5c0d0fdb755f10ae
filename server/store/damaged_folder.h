// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/stat.h>

#include <filesystem>
#include <string>
#include <vector>

#include "server/store/store.h"

/// The folder `damaged` of a store: files that are out of the way, with the reasons beside them. Private to
/// the store.
namespace cairn {

inline constexpr const char* kMapSuffix = ".cairnmap";
inline constexpr const char* kMapLogSuffix = ".cairnmap-wal";
inline constexpr const char* kCatalogueSuffix = ".db";

/// The present time as text, for the name of a file that is set aside now.
[[nodiscard]] std::string utc_stamp();
/// When a file was changed.
[[nodiscard]] Timestamp changed_at(const struct stat& file);

/// Path of the text that says why a file was set aside.
[[nodiscard]] std::filesystem::path reasons_path_of(const std::filesystem::path& file);
/// Writes for operators why a file was set aside; damaged_files_in() reads it. `name`: of the map, where it
/// is known.
void write_reasons(const std::filesystem::path& beside, const std::string& name,
                   const std::vector<std::string>& reasons);

/// The files in a folder that have been set aside, by id and time.
[[nodiscard]] std::vector<DamagedFile> damaged_files_in(const std::filesystem::path& folder);

}  // namespace cairn
