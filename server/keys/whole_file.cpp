// SPDX-License-Identifier: Apache-2.0
#include "server/keys/whole_file.h"

#include <fcntl.h>
#include <stdlib.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string>
#include <utility>

#include "common/base/file_descriptor.h"
#include "common/io/text.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

tl::unexpected<Error> not_written(const fs::path& path) {
  return fail(ErrorCode::kIo, cannot_be_written(path));
}

bool write_all(int descriptor, std::string_view content) {
  while (!content.empty()) {
    const ssize_t written = write(descriptor, content.data(), content.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return false;
    content.remove_prefix(static_cast<size_t>(written));
  }
  return fsync(descriptor) == 0;
}

/// A new name is on the disk only with the folder that has it.
Status sync_folder(const fs::path& folder) {
  const FileDescriptor descriptor(
      open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (descriptor.get() < 0 || fsync(descriptor.get()) != 0) return not_written(folder);
  return {};
}

}  // namespace

Status write_whole_file(const fs::path& path, std::string_view content, mode_t mode) {
  std::string unfinished = path.string() + ".XXXXXX";
  const FileDescriptor file(mkostemp(unfinished.data(), O_CLOEXEC));  // 0600
  if (file.get() < 0) return not_written(path);
  const bool is_there = write_all(file.get(), content) && fchmod(file.get(), mode) == 0 &&
                        std::rename(unfinished.c_str(), path.c_str()) == 0;
  if (!is_there) {
    const auto error = not_written(path);  // before errno is another's
    unlink(unfinished.c_str());
    return error;
  }
  return sync_folder(path.parent_path());
}

Result<UnfinishedFolder> UnfinishedFolder::make_beside(const fs::path& place) {
  std::error_code problem;
  const fs::path above = place.parent_path();
  if (!above.empty()) fs::create_directories(above, problem);
  if (problem) return fail(ErrorCode::kIo, above.string() + ": cannot be made: " + problem.message());
  const std::string hidden = std::string(".").append(place.filename().string()).append(".XXXXXX");
  std::string made = (above / hidden).string();
  if (mkdtemp(made.data()) == nullptr) return not_written(place);
  return UnfinishedFolder(made, place);
}

UnfinishedFolder::UnfinishedFolder(UnfinishedFolder&& other) noexcept
    : path_(std::exchange(other.path_, {})), place_(std::move(other.place_)) {}

UnfinishedFolder::~UnfinishedFolder() {
  std::error_code ignored;
  if (!path_.empty()) fs::remove_all(path_, ignored);
}

Status UnfinishedFolder::leave() {
  // Where there is one already they change places, and the old one goes with this object.
  const bool is_exchanged =
      renameat2(AT_FDCWD, path_.c_str(), AT_FDCWD, place_.c_str(), RENAME_EXCHANGE) == 0;
  if (!is_exchanged) {
    if (errno != ENOENT || std::rename(path_.c_str(), place_.c_str()) != 0) return not_written(place_);
    path_.clear();
  }
  return sync_folder(place_.parent_path());
}

}  // namespace cairn
