// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/stat.h>

#include <filesystem>
#include <string_view>

#include "common/base/result.h"

/// Files and folders that are there whole or not at all, also after a crash. Errors kIo name the path.
namespace cairn {

constexpr mode_t kSecretFile = 0600;
constexpr mode_t kPublicFile = 0644;

/// Beside `path` first, then moved there; the one of that name goes.
[[nodiscard]] Status write_whole_file(const std::filesystem::path& path, std::string_view content,
                                      mode_t mode);

/// A folder (0700) for what is not finished, beside the one where it will be left.
class UnfinishedFolder {
 public:
  /// Makes the folders above too.
  [[nodiscard]] static Result<UnfinishedFolder> make_beside(const std::filesystem::path& place);
  ~UnfinishedFolder();
  UnfinishedFolder(UnfinishedFolder&& other) noexcept;
  UnfinishedFolder& operator=(UnfinishedFolder&&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  /// Finished: takes its place; what was there goes.
  [[nodiscard]] Status leave();

 private:
  UnfinishedFolder(std::filesystem::path path, std::filesystem::path place)
      : path_(std::move(path)), place_(std::move(place)) {}
  std::filesystem::path path_;
  std::filesystem::path place_;
};

}  // namespace cairn
