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

constexpr size_t kCopyBytes = size_t{1} << 20;

struct Descriptor {
  explicit Descriptor(int n) : number(n) {}
  ~Descriptor() {
    if (number >= 0) ::close(number);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  const int number;
};

/// Renames a file. Returns 0 or an error number; EEXIST when something is at `to`, which stays.
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
  const auto not_moved = [&](const fs::path& file, const std::string& why) {
    return io_failure(
        file, "cannot be moved to " + to.string() + ": " + why + "; see to owner and mount of both folders");
  };
  if (error != 0) return not_moved(from, std::strerror(error));
  std::error_code problem;
  std::vector<std::string> moved{""};
  for (const char* companion : kCompanions) {
    const fs::path source = from.string() + companion;
    if (!is_there(source)) continue;
    fs::rename(source, to.string() + companion, problem);
    if (!problem) {
      moved.emplace_back(companion);
      continue;
    }
    std::error_code ignored;  // all of it or nothing
    for (const std::string& end : moved) fs::rename(to.string() + end, from.string() + end, ignored);
    return not_moved(source, problem.message());
  }
  // Rather in both folders than in none.
  sync_folder(to.parent_path());
  if (to.parent_path() != from.parent_path()) sync_folder(from.parent_path());
  return {};
}

Status remove_database(const fs::path& path) {
  std::error_code problem;
  fs::remove(path, problem);
  if (problem)
    return io_failure(path, "cannot be removed: " + problem.message() + "; see to owner and mount");
  for (const char* companion : kCompanions) fs::remove(path.string() + companion, problem);
  return {};
}

void discard_database(const fs::path& path) {
  (void)remove_database(path);
}

Status copy_bytes(const fs::path& from, const fs::path& to) {
  const Descriptor in(::open(from.c_str(), O_RDONLY | O_CLOEXEC));
  if (in.number < 0) return io_failure(from, std::string("cannot be read: ") + std::strerror(errno));
  const Descriptor out(::open(to.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0640));
  if (out.number < 0) return io_failure(to, std::string("cannot be made: ") + std::strerror(errno));
  std::vector<uint8_t> piece(kCopyBytes);
  while (true) {
    const ssize_t got = ::read(in.number, piece.data(), piece.size());
    if (got == 0) return {};
    if (got < 0) return io_failure(from, std::string("cannot be read: ") + std::strerror(errno));
    if (Status written = write_all(out.number, std::span(piece).first(static_cast<size_t>(got))); !written)
      return io_failure(to, written.error().message);
  }
}

Status write_all(int descriptor, std::span<const uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(descriptor, bytes.data(), bytes.size());
    if (written < 0) return fail(ErrorCode::kIo, std::string("cannot be written: ") + std::strerror(errno));
    bytes = bytes.subspan(static_cast<size_t>(written));
  }
  return {};
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
