// SPDX-License-Identifier: Apache-2.0
#include "server/store/database_files.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <system_error>

namespace cairn {
namespace {

namespace fs = std::filesystem;

/// 0 or an error number; EEXIST when something is there, which stays.
int rename_unless_taken(const fs::path& from, const fs::path& to) {
  if (::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) == 0) return 0;
  if (errno != EINVAL && errno != ENOSYS) return errno;
  // Not known to this file system.
  std::error_code ignored;
  if (fs::exists(fs::symlink_status(to, ignored))) return EEXIST;
  return ::rename(from.c_str(), to.c_str()) == 0 ? 0 : errno;
}

}  // namespace

tl::unexpected<Error> io_failure(const fs::path& path, const std::string& what) {
  return fail(ErrorCode::kIo, path.string() + ": " + what);
}

void sync_folder(const fs::path& folder) {
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return;
  ::fsync(descriptor);
  ::close(descriptor);
}

bool is_there(const fs::path& path) {
  std::error_code ignored;
  return fs::exists(path, ignored);
}

Status move_database(const fs::path& from, const fs::path& to) {
  const int error = rename_unless_taken(from, to);
  if (error == EEXIST) return fail(ErrorCode::kRefused, to.string() + ": there is such a file already");
  if (error != 0) return io_failure(from, "cannot be moved to " + to.string() + ": " + std::strerror(error));
  std::error_code problem;
  for (const char* companion : kCompanions) {
    const fs::path source = from.string() + companion;
    if (!is_there(source)) continue;
    fs::rename(source, to.string() + companion, problem);
    if (problem) return io_failure(source, "cannot be moved to " + to.string() + ": " + problem.message());
  }
  // Rather in both folders than in none.
  sync_folder(to.parent_path());
  if (to.parent_path() != from.parent_path()) sync_folder(from.parent_path());
  return {};
}

void remove_database(const fs::path& path) {
  std::error_code ignored;
  fs::remove(path, ignored);
  for (const char* companion : kCompanions) fs::remove(path.string() + companion, ignored);
}

bool has_log(const fs::path& file) {
  std::error_code problem;
  const uintmax_t size = fs::file_size(file.string() + kLogEnd, problem);
  return !problem && size > 0;
}

fs::path free_path(const fs::path& folder, const std::string& stem, const std::string& suffix) {
  fs::path path = folder / (stem + suffix);
  std::error_code ignored;
  for (int i = 2; fs::exists(path, ignored); ++i)
    path = folder / std::string(stem).append("-").append(std::to_string(i)).append(suffix);
  return path;
}

Result<std::vector<fs::path>> entries_of(const fs::path& folder) {
  std::error_code problem;
  std::vector<fs::path> entries;
  for (fs::directory_iterator it(folder, problem), end; !problem && it != end; it.increment(problem))
    entries.push_back(it->path());
  if (problem) return io_failure(folder, "cannot be read: " + problem.message());
  return entries;
}

}  // namespace cairn
