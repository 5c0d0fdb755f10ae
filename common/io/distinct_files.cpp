// SPDX-License-Identifier: Apache-2.0
#include "common/io/distinct_files.h"

#include <sys/stat.h>

#include <compare>
#include <cstdint>
#include <optional>

namespace cairn {
namespace {

/// A file that is there, or (with a name) where one will be.
struct Identity {
  uint64_t device = 0;
  uint64_t inode = 0;
  std::string name;
  friend bool operator==(const Identity&, const Identity&) = default;
};

/// The path at the end of a chain of links, for links that lead to no file yet.
std::filesystem::path follow(std::filesystem::path path) {
  constexpr int kMostLinks = 40;  // as the kernel
  std::error_code error;
  for (int i = 0; i < kMostLinks && std::filesystem::is_symlink(path, error); ++i) {
    const auto target = std::filesystem::read_symlink(path, error);
    if (error) break;
    path = path.parent_path() / target;
  }
  return path;
}

/// Nothing for a device, a folder, and where nothing can be.
std::optional<Identity> identity_of(const std::filesystem::path& path) {
  struct stat about {};
  if (stat(path.c_str(), &about) == 0) {
    if (S_ISCHR(about.st_mode) || S_ISDIR(about.st_mode)) return std::nullopt;
    return Identity{about.st_dev, about.st_ino, {}};
  }
  const auto target = follow(path);
  const auto folder = target.has_parent_path() ? target.parent_path() : std::filesystem::path(".");
  if (stat(folder.c_str(), &about) != 0) return std::nullopt;
  return Identity{about.st_dev, about.st_ino, target.filename().string()};
}

std::string text_of(const NamedFile& file) {
  return file.role + " " + file.path.string();
}

}  // namespace

Status check_distinct(const std::vector<NamedFile>& outputs, const std::vector<NamedFile>& inputs) {
  for (size_t i = 0; i < outputs.size(); ++i) {
    const auto identity = identity_of(outputs[i].path);
    if (!identity) continue;
    for (const NamedFile& input : inputs) {
      if (identity_of(input.path) != identity) continue;
      return fail(ErrorCode::kUsage, text_of(outputs[i]) + " would replace what is read: " + text_of(input) +
                                         "; name another file");
    }
    for (size_t j = 0; j < i; ++j) {
      if (identity_of(outputs[j].path) != identity) continue;
      return fail(ErrorCode::kUsage,
                  text_of(outputs[j]) + " and " + text_of(outputs[i]) + " are the same file; name two");
    }
  }
  return {};
}

}  // namespace cairn
