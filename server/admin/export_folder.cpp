// SPDX-License-Identifier: Apache-2.0
#include "server/admin/export_folder.h"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <utility>
#include <vector>

#include "server/admin/scene_files.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

/// What lies under the folder of an exported map.
struct Part {
  const char* name;
  Status (*write)(const ExportedScene& scene, const fs::path& path);
  bool (*is_ours)(const fs::path& file);  ///< one of the files that `write` writes
};

/// `name`.txt or .bin of a model.
bool is_of_model(const fs::path& file, const char* extension) {
  const fs::path stem = file.stem();
  return file.extension() == extension && (stem == "cameras" || stem == "images" || stem == "points3D");
}

bool is_exported_ply(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::string begin(200, '\0');
  in.read(begin.data(), static_cast<std::streamsize>(begin.size()));
  return begin.find(kPlyComment) != std::string::npos;
}

const Part kText{"sparse-text", write_colmap_text, [](const fs::path& f) { return is_of_model(f, ".txt"); }};
const Part kBinary{"sparse", write_colmap_binary, [](const fs::path& f) { return is_of_model(f, ".bin"); }};
const Part kImages{"images", write_images, is_exported_image_name};
const Part kPly{"points.ply", write_ply, is_exported_ply};

std::vector<Part> parts_of(const std::string& format, const fs::path& place) {
  std::vector<Part> parts;
  const bool all = format == "all";
  if (all || format.starts_with("colmap")) {
    std::error_code ignored;
    if (all || format == "colmap-text" || fs::exists(place / kText.name, ignored)) parts.push_back(kText);
    if (all || format == "colmap" || fs::exists(place / kBinary.name, ignored)) parts.push_back(kBinary);
    parts.push_back(kImages);
  }
  if (all || format == "ply") parts.push_back(kPly);
  return parts;
}

/// Whether all that lies there is an earlier export's. Error kRefused.
Status check_replaceable(const Part& part, const fs::path& place) {
  const auto refuse = [](const fs::path& path) {
    return fail(ErrorCode::kRefused,
                path.string() +
                    " lies where the export goes and is not of an earlier one; move it, or export "
                    "to another folder (--out)");
  };
  std::error_code problem;
  const fs::file_status there = fs::symlink_status(place, problem);
  if (!fs::exists(there)) return {};
  if (!fs::is_directory(there)) return part.is_ours(place) ? Status() : refuse(place);
  fs::directory_iterator it(place, problem);
  for (const fs::directory_iterator end; !problem && it != end; it.increment(problem)) {
    if (!it->is_regular_file(problem) || !part.is_ours(it->path())) return refuse(it->path());
  }
  if (problem) return fail(ErrorCode::kIo, place.string() + ": cannot be read: " + problem.message());
  return {};
}

Status move_path(const fs::path& from, const fs::path& to, const fs::path& meant) {
  std::error_code problem;
  fs::rename(from, to, problem);
  if (!problem) return {};
  return fail(ErrorCode::kIo, meant.string() + ": cannot be written: " + problem.message());
}

/// Puts what is finished in the place of what is there, which is kept until then.
Status swap_in(const fs::path& finished, const fs::path& place) {
  const fs::path former = finished.string() + ".former";
  std::error_code ignored;
  const bool replaces = fs::exists(fs::symlink_status(place, ignored));
  if (replaces) {
    if (Status moved = move_path(place, former, place); !moved) return moved;
  }
  Status moved = move_path(finished, place, place);
  if (!moved && replaces) fs::rename(former, place, ignored);
  return moved;
}

}  // namespace

Result<StagingFolder> StagingFolder::make_in(const fs::path& folder) {
  std::error_code problem;
  fs::create_directories(folder, problem);
  if (problem) return fail(ErrorCode::kIo, folder.string() + ": cannot be made: " + problem.message());
  std::string path = folder / ".cairnctl-XXXXXX";
  if (::mkdtemp(path.data()) != nullptr) return StagingFolder(path);
  return fail(ErrorCode::kIo, folder.string() + ": cannot be written: " + std::strerror(errno));
}

StagingFolder::~StagingFolder() {
  std::error_code ignored;
  if (!path_.empty()) fs::remove_all(path_, ignored);
}

Error StagingFolder::told_of(const fs::path& place, Error error) const {
  const std::string here = path_.string();
  if (error.message.starts_with(here + "/")) error.message.replace(0, here.size(), place.string());
  return error;
}

Status leave_file(const fs::path& finished, const fs::path& place) {
  return move_path(finished, place, place);
}

Status leave_scene(const ExportedScene& scene, const std::string& format, const StagingFolder& staging,
                   const fs::path& place) {
  const std::vector<Part> parts = parts_of(format, place);
  for (const Part& part : parts) {
    if (Status free = check_replaceable(part, place / part.name); !free) return free;
  }
  for (const Part& part : parts) {
    if (Status written = part.write(scene, staging.path() / part.name); !written)
      return tl::unexpected(staging.told_of(place, written.error()));
  }
  std::error_code problem;
  fs::create_directories(place, problem);
  if (problem) return fail(ErrorCode::kIo, place.string() + ": cannot be made: " + problem.message());
  for (const Part& part : parts) {
    if (Status left = swap_in(staging.path() / part.name, place / part.name); !left) return left;
  }
  return {};
}

}  // namespace cairn
