// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

/// What the operating system has to say when a file takes nothing; SQLite keeps it to itself. Safe to call
/// from any thread.
namespace cairn {

/// Why a file, or one that is to be made there, cannot be written, in the system's words ("Read-only file
/// system"). Empty: it could be.
[[nodiscard]] std::string why_not_writable(const std::filesystem::path& file);

/// Which other program holds a lock on a database file: "sqlite3 (process 4711)". Empty: none that can be
/// seen. The file is not opened, since closing it would drop this process's own locks (POSIX).
[[nodiscard]] std::string holder_of_lock(const std::filesystem::path& database);

}  // namespace cairn
