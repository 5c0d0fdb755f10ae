// SPDX-License-Identifier: Apache-2.0
#include "server/service/health.h"

#include <utility>

#include "common/base/utf8.h"
#include "server/service/admin_reply.h"

namespace cairn {
namespace {

constexpr size_t kMaxHealthBytes = 1000;  // ServerStatus takes a little more

}  // namespace

Health::Health(const ServiceContext& context, const MapArray& maps) : context_(context), maps_(maps) {
  if (context_.store != nullptr) damaged_ = context_.store->damaged_files();
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
    if (entry.frozen.empty()) continue;
    add(entry.name + " is frozen until the server starts again: " + entry.frozen);
    break;  // one is enough to have a look; `cairnctl maps` names all
  }
  return words.empty() ? "ok" : std::string(cut_text(one_line(words), kMaxHealthBytes));
}

void Health::note(std::vector<DamagedFile> damaged, std::vector<UnloadedMap> unloaded) {
  damaged_ = std::move(damaged);
  unloaded_ = std::move(unloaded);
}

void Health::look_again() {
  context_.store->run_beside([this](const Store& store) {
    context_.post([this, damaged = store.damaged_files(), unloaded = context_.store->unloaded()] {
      note(damaged, unloaded);
    });
  });
}

void Health::note_restored() {
  if (context_.store != nullptr) unloaded_ = context_.store->unloaded();
}

}  // namespace cairn
