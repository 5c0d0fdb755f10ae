// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "common/base/result.h"
#include "server/admin/exported_scene.h"

/// Folders where exported maps are left: each file and folder once it is whole, in the place of what an
/// earlier export has left there, which is told by its names.
namespace cairn {

/// A folder of its own for what is not finished, within the one where that will be left, so that moving it
/// there copies nothing. It goes with all that is in it.
class StagingFolder {
 public:
  /// Makes `folder` too. Error kIo.
  [[nodiscard]] static Result<StagingFolder> make_in(const std::filesystem::path& folder);
  ~StagingFolder();
  StagingFolder(StagingFolder&& other) noexcept : path_(std::move(other.path_)) { other.path_.clear(); }
  StagingFolder(const StagingFolder&) = delete;
  StagingFolder& operator=(const StagingFolder&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  /// An error with a file in this folder, told of the path under `place` where the file was to go, which is
  /// what its user knows.
  [[nodiscard]] Error told_of(const std::filesystem::path& place, Error error) const;

 private:
  explicit StagingFolder(std::filesystem::path path) : path_(std::move(path)) {}
  std::filesystem::path path_;
};

/// Moves a finished file to its place; the one of that name goes. Error kIo: that stays.
[[nodiscard]] Status leave_file(const std::filesystem::path& finished, const std::filesystem::path& place);

/// The scene in `format` (colmap, colmap-text, ply or all) under `place`, written in `staging` first. What an
/// earlier export has left there is replaced; of COLMAP's two kinds of model also the one that was not asked
/// for, since its images go. Errors: kRefused (something else lies in the way: nothing is touched), kIo.
[[nodiscard]] Status leave_scene(const ExportedScene& scene, const std::string& format,
                                 const StagingFolder& staging, const std::filesystem::path& place);

}  // namespace cairn
