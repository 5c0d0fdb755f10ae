// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "common/base/result.h"

/// SQLite's database files as things in folders: moved, removed and found together with their companions.
/// Private to the store; safe to call from any thread, for different files.
namespace cairn {

/// End of the name of the log that belongs to a database file.
inline constexpr const char* kLogEnd = "-wal";
/// Ends of the names of the files that SQLite lays beside a database file.
inline constexpr const char* kCompanions[] = {kLogEnd, "-shm", "-journal"};

/// Error kIo, with the file's name before what happened.
[[nodiscard]] tl::unexpected<Error> io_failure(const std::filesystem::path& path, const std::string& what);

/// Makes entries of a folder durable.
void sync_folder(const std::filesystem::path& folder);

[[nodiscard]] bool is_there(const std::filesystem::path& path);

/// Moves a database file with its companions to another place. An end in between leaves a log without its
/// file (Store::part_with_lone_log()). Errors, after which all of it is where it was: kRefused (the place is
/// taken), kIo.
[[nodiscard]] Status move_database(const std::filesystem::path& from, const std::filesystem::path& to);

/// Removes a database file with its companions; that there is none is no error. Error kIo, after which all of
/// it is still there.
[[nodiscard]] Status remove_database(const std::filesystem::path& path);
/// remove_database() for callers that have something worse to tell. What stays is removed before the next
/// file is made there.
void discard_database(const std::filesystem::path& path);

/// Copies the bytes of a file. Errors kIo, with the system's reason; what was written stays.
[[nodiscard]] Status copy_bytes(const std::filesystem::path& from, const std::filesystem::path& to);
/// Writes all bytes. Error kIo, without a name of a file.
[[nodiscard]] Status write_all(int descriptor, std::span<const uint8_t> bytes);

/// Whether a database file has a log that holds something; an empty one does not.
[[nodiscard]] bool has_log(const std::filesystem::path& file);

/// A path in the folder that is not taken: `stem`, with a number if there is one already.
[[nodiscard]] std::filesystem::path free_path(const std::filesystem::path& folder, const std::string& stem,
                                              const std::string& suffix);

/// The entries of a folder. Error kIo: it cannot be read.
[[nodiscard]] Result<std::vector<std::filesystem::path>> entries_of(const std::filesystem::path& folder);

}  // namespace cairn
