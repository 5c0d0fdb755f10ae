// SPDX-License-Identifier: Apache-2.0
#include "server/service/health.h"

#include <utility>

#include "common/base/utf8.h"
#include "common/wire/limits.h"

namespace cairn {
namespace {

constexpr size_t kMaxHealthBytes = 1000;
static_assert(kMaxHealthBytes <= wire::kMaxReasonBytes);

}  // namespace

std::string word_of_damage(size_t files, const std::filesystem::path& folder) {
  if (files == 0) return {};
  return std::to_string(files) + (files == 1 ? " damaged file was" : " damaged files were") +
         " set aside in " + folder.string() +
         " (`cairnctl maps` says why); import what is missing from a backup, then move " +
         (files == 1 ? "it" : "them") + " out of there";
}

std::string word_of_unloaded(std::span<const UnloadedMap> maps) {
  if (maps.empty()) return {};
  const std::string how_many = maps.size() == 1 ? "a map is" : std::to_string(maps.size()) + " maps are";
  return how_many + " not served (`cairnctl maps`): " + maps.front().reason +
         "; see to that and start the server again, or move the file away and import an archive";
}

Health::Health(const ServiceContext& context, const MapArray& maps) : context_(context), maps_(maps) {
  if (context_.store != nullptr) damaged_ = context_.store->opening().damaged_files();
}

std::string Health::words() const {
  const MapPersistence* store = context_.store;
  std::string words = store ? store->trouble() : std::string();
  const auto add = [&words](const std::string& word) {
    if (!words.empty() && !word.empty()) words += "; ";
    words += word;
  };
  add(context_.site.trouble());
  add(word_of_unloaded(unloaded_));
  if (store) add(word_of_damage(damaged_.size(), store->folder() / "damaged"));
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.failed.empty()) continue;
    add(entry.name + " takes nothing until the server starts again: " + entry.failed);
    break;  // one is enough to have a look; `cairnctl maps` names all
  }
  return words.empty() ? "ok" : std::string(cut_text(one_line(words), kMaxHealthBytes));
}

void Health::note(std::vector<DamagedFile> damaged, std::vector<UnloadedMap> unloaded) {
  damaged_ = std::move(damaged);
  unloaded_ = std::move(unloaded);
}

void Health::look_again() {
  context_.store->run_on_strand([this](const Store& store) {
    context_.post([this, damaged = store.damaged_files(), unloaded = context_.store->opening().unloaded()] {
      note(damaged, unloaded);
    });
  });
}

void Health::note_restored() {
  if (context_.store != nullptr) unloaded_ = context_.store->opening().unloaded();
}

}  // namespace cairn
