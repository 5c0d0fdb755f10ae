// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "server/service/map_array.h"
#include "server/service/service_context.h"

namespace cairn {

/// Says how many damaged files lie in a folder, and the remedy. Empty when none does.
[[nodiscard]] std::string word_of_damage(size_t files, const std::filesystem::path& folder);
/// Says how many maps are not served, why the first of them is not, and the remedy. Empty when there is none.
[[nodiscard]] std::string word_of_unloaded(std::span<const UnloadedMap> maps);

/// Whether all is well with the server, and what is not: the store, the rights, the maps that were damaged,
/// could not be loaded, or have failed. Used from the service's thread.
class Health {
 public:
  Health(const ServiceContext& context, const MapArray& maps);
  Health(const Health&) = delete;
  Health& operator=(const Health&) = delete;

  /// "ok", or what is wrong, with a remedy where one is known.
  [[nodiscard]] std::string words() const;
  /// Files that have been set aside, and maps that could not be loaded, as they were when last looked for.
  [[nodiscard]] const std::vector<DamagedFile>& damaged() const { return damaged_; }
  [[nodiscard]] const std::vector<UnloadedMap>& unloaded() const { return unloaded_; }
  /// Takes over the damaged files and the unloaded maps that somebody has just looked for.
  void note(std::vector<DamagedFile> damaged, std::vector<UnloadedMap> unloaded);
  /// Looks for both again, beside the store's writer: an operator may have taken something away.
  void look_again();
  /// Takes over the unloaded maps. To be called when all maps of the store have been read.
  void note_restored();

 private:
  const ServiceContext& context_;
  const MapArray& maps_;
  std::vector<DamagedFile> damaged_;
  std::vector<UnloadedMap> unloaded_;
};

}  // namespace cairn
