// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/map/ids.h"
#include "server/store/map_file.h"

/// A look at every row of a store's files. It changes nothing that a start would not change.
namespace cairn {

/// The result of checking one file.
struct FileCheck {
  std::string part;  ///< as below the store's folder: "maps/ID.cairnmap"
  std::string name;  ///< of a map, where it could be read
  size_t keyframes = 0, points = 0, labels = 0, tags = 0;
  std::string not_checked = {};                  ///< why: the disk is full, or the file may not be opened
  std::vector<std::string> faults;               ///< for a person; none, and checked: it is sound
  std::vector<std::string> lost_proposals = {};  ///< likewise: of a map that is whole without them
  std::string remedy;                            ///< where there are any
};

/// Checks a text of rights, which is not of this folder's making. Error kDamaged: it is none.
using CheckRights = std::function<Status(const std::string& text)>;

/// Checks the file `part` of the store in `folder`: reads and decodes every row and every image, and whether
/// they agree with each other, as of one moment. May run beside a server; `in_use`: the server has the file.
[[nodiscard]] FileCheck check_part(const std::filesystem::path& folder, const std::string& part,
                                   const CheckRights& rights, FileInUse in_use = FileInUse::kNo);

/// The files of a store that are worth keeping, in the order in which a backup takes them: the rights last,
/// so that they are never older than a map they close.
[[nodiscard]] Result<std::vector<std::string>> parts_of_store(const std::filesystem::path& folder);

/// Whether a part follows another in that order, be they there or not.
[[nodiscard]] bool comes_later(const std::string& part, const std::string& than);

/// A copy of one of them, consistent as of one moment. `to` must not exist. Errors: kUsage (no such part can
/// be), kNotFound, as MapFile::open().
[[nodiscard]] Status copy_part(const std::filesystem::path& folder, const std::string& part,
                               const std::filesystem::path& to);

/// Makes a store in `folder` of a backup that has been unpacked in `unpacked`, a folder beside it, once every
/// file there is sound. `folder` does not exist or is empty. Errors: kDamaged (the first fault), kIo.
[[nodiscard]] Status settle_restored(const std::filesystem::path& unpacked,
                                     const std::filesystem::path& folder, const CheckRights& rights,
                                     const std::string& who);

}  // namespace cairn
