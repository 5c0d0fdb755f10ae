// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_administration.h"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <utility>

#include "server/service/store_tasks.h"

/// What operators do to maps. The store's part is done beside its writer, so that no verdict waits for it.
namespace cairn {
namespace {

/// Deleted maps that an operator may mean by a name or an id, the latest deleted first.
std::vector<DeletedMap> deleted_maps_called(const Store& store, const std::string& name_or_id) {
  std::vector<DeletedMap> maps = store.deleted_maps();
  std::erase_if(maps, [&](const DeletedMap& m) {
    const bool is_called_so = !m.problem && m.header.name == name_or_id;
    return !is_called_so && to_hex(m.header.id.bytes) != name_or_id;
  });
  return maps;
}

/// Which of them? Ids, and when they were deleted.
Error ambiguous(const std::string& wanted, const std::vector<DeletedMap>& maps, const std::string& live) {
  std::string message = "which '" + wanted + "'? Say it by its id:";
  for (const DeletedMap& map : maps) {
    const std::time_t seconds = map.deleted.nanoseconds / 1'000'000'000;
    std::tm parts{};
    gmtime_r(&seconds, &parts);
    char text[32];
    std::strftime(text, sizeof(text), "%Y-%m-%d %H:%M:%S", &parts);
    message += fmt::format(" {} (deleted {} UTC)", to_hex(map.header.id.bytes), text);
  }
  return {ErrorCode::kRefused, message + live};
}

}  // namespace

void MapAdministration::rename(MapId id, MapEntry* entry, const std::string& name,
                               const AdminAnswer& answer) {
  if (!is_valid_name(name))
    return answer(refusal(ErrorCode::kUsage, "name '" + name + "': expected 1 to 32 of a-z, 0-9 and -"));
  if (entry->name == name) return answer(overview_.describe(id, *entry));
  if (!maps_.array().names().is_free(name))
    return answer(refusal(ErrorCode::kRefused, "another map is called '" + name + "'"));
  if (entry->runner == nullptr) return answer(refusal(ErrorCode::kRefused, kMadeElsewhere));
  if (!entry->name_to_be.empty())
    return answer(refusal(ErrorCode::kRefused, "the map is being renamed by another; try again"));
  if (entry->rolling_back) return answer(refusal(ErrorCode::kRefused, kRollingBack));
  maps_.array().begin_renaming(entry, name);
  maps_.young().forget(id);
  entry->runner->rename(name, [this, id, answer](const Status& kept) {
    context_.post([this, id, answer, kept] {
      MapEntry* renamed = maps_.array().find(id);
      if (renamed == nullptr) return answer(refusal(ErrorCode::kNotFound, "the map has gone meanwhile"));
      maps_.array().end_renaming(renamed, kept.has_value());
      if (!kept) return answer(refusal(kept.error()));
      news_.tell(id, *renamed);
      answer(overview_.describe(id, *renamed));
    });
  });
}

void MapAdministration::remove(MapId id, MapEntry* entry, bool for_good, const AdminAnswer& answer) {
  if (entry->runner == nullptr) return answer(refusal(ErrorCode::kRefused, kMadeElsewhere));
  if (context_.store == nullptr && !for_good) {
    return answer(refusal(ErrorCode::kRefused,
                          "this server keeps nothing (no --store): the map could not be had back; "
                          "--for-good deletes it all the same"));
  }
  if (context_.store != nullptr && for_good) {
    return answer(refusal(ErrorCode::kUsage,
                          "a deleted map can be had back from this server until `cairnctl maps purge`; "
                          "delete it without --for-good"));
  }
  if (context_.store == nullptr) {
    entry->runner->retire();
    return finish_removal(id, {}, answer);
  }
  if (entry->rolling_back) return answer(refusal(ErrorCode::kRefused, kRollingBack));
  entry->leaving = true;
  // All that is handed in is written, exports of it that are under way come to their end, and then its file
  // goes, in the writer's turn. Until then the map is served: it may yet stay.
  const auto remove_file = [this, id, runner = entry->runner, answer](Store& store) {
    const Status removed = store.remove(id);
    if (removed) runner->retire();
    context_.post([this, id, removed, answer] { finish_removal(id, removed, answer); });
  };
  entry->runner->flush([this, answer, remove_file](const Status&) {  // a full disk keeps no map from going
    context_.store->run([this, answer, remove_file](const Store&) {
      on_store_strand(context_, answer, [this, remove_file](const Store&) -> Task {
        context_.store->run(remove_file);
        return {};
      });
    });
  });
}

void MapAdministration::finish_removal(MapId id, const Status& removed, const AdminAnswer& answer) {
  MapEntry* entry = maps_.array().find(id);
  if (entry == nullptr) return answer(told::GoneMap{id});  // by another operator meanwhile
  if (!removed) {
    entry->leaving = false;
    return answer(refusal(removed.error()));
  }
  const told::Map deleted = describe_map(id, *entry);
  maps_.forget(id);
  if (context_.store == nullptr) {
    places_.forget_overlaps(id);
    context_.site.forget(id, deleted.name);
  }
  answer(deleted);
}

void MapAdministration::drop_dead(MonotonicTime now) {
  if (context_.options.drop_after.count() == 0) return;
  for (const YoungMaps::Dead& dead : maps_.young().dead(now, context_.options.drop_after)) {
    MapEntry* entry = maps_.array().find(dead.map);
    if (entry != nullptr && (entry->seeding || entry->offers_in_work > 0)) continue;  // it may yet be of use
    maps_.young().forget(dead.map);
    if (entry == nullptr || entry->leaving || entry->rolling_back || !entry->failed.empty()) continue;
    const std::string id = to_hex(dead.map.bytes);
    context_.log->info("{} is dropped: {} lost it after {:.1f} s, and nobody has been found in it since{}",
                       entry->name, dead.maker, std::chrono::duration<double>(dead.tracked).count(),
                       context_.store == nullptr ? "" : "; `cairnctl map " + id + " undelete` puts it back");
    const bool for_good = context_.store == nullptr;
    remove(dead.map, entry, for_good, [log = context_.log, name = entry->name](const OperatorAnswer& told) {
      if (!told) log->warn("{} could not be dropped: {}", name, words_of(told.error()));
    });
  }
}

void MapAdministration::answer_without_map(const std::string& verb, const std::string& wanted,
                                           const AdminAnswer& answer) {
  if (context_.store == nullptr) return answer(unknown_map(wanted));
  on_store_strand(context_, answer, [verb, wanted, answer](const Store& store) -> Task {
    const std::vector<DeletedMap> maps = deleted_maps_called(store, wanted);
    const auto told = [&]() -> OperatorAnswer {
      if (maps.empty()) return unknown_map(wanted);
      if (verb == "delete") return maps.front();
      if (maps.size() > 1) return refusal(ambiguous(wanted, maps, ""));
      return maps.front().problem ? refusal(maps.front()) : deleted_map(wanted);
    };
    return telling(answer, told());
  });
}

void MapAdministration::undelete(const std::string& wanted, const AdminAnswer& answer) {
  const auto [id, entry] = find_called(maps_.array(), wanted);
  std::optional<told::BusyMap> live;
  if (entry != nullptr) live = overview_.describe(id, *entry);
  const std::string full = capacity_.why_full();
  on_store_strand(context_, answer, [this, wanted, answer, live, full](Store& store) -> Task {
    const std::vector<DeletedMap> maps = deleted_maps_called(store, wanted);
    const auto say = [&answer](OperatorAnswer told) { return telling(answer, std::move(told)); };
    if (maps.empty() && live) return say(*live);
    if (maps.empty()) return say(refusal(ErrorCode::kNotFound, "no deleted map '" + wanted + "'"));
    if (maps.size() > 1 || live) {
      const std::string in_use =
          live ? fmt::format(" {} (in use)", to_hex(live->map.id.bytes)) : std::string();
      return say(refusal(ambiguous(wanted, maps, in_use)));
    }
    if (maps[0].problem) return say(refusal(maps[0]));
    if (!full.empty()) return say(refusal(ErrorCode::kRefused, full));
    if (const Status back = store.undelete(maps[0].header.id); !back) return say(refusal(back.error()));
    take_in(maps[0].header.id, &Store::undo_undelete, answer);
    return {};
  });
}

void MapAdministration::purge(const std::string& wanted, const AdminAnswer& answer) {
  on_store_strand(context_, answer, [this, wanted, answer](Store& store) -> Task {
    const std::vector<DeletedMap> maps = deleted_maps_called(store, wanted);
    const auto say = [&answer](OperatorAnswer told) { return telling(answer, std::move(told)); };
    if (maps.empty()) return say(refusal(ErrorCode::kNotFound, "no deleted map '" + wanted + "'"));
    if (maps.size() > 1) return say(refusal(ambiguous(wanted, maps, "")));
    // Not by mistake what can be read again tomorrow.
    if (maps[0].problem && maps[0].problem->code != ErrorCode::kDamaged) return say(refusal(maps[0]));
    const Status purged = store.purge(maps[0].header.id);
    if (!purged) return say(refusal(purged.error()));
    return [this, answer, map = maps[0]] {
      places_.forget_overlaps(map.header.id);
      context_.site.forget(map.header.id, map.header.name);
      answer(map);
    };
  });
}

void MapAdministration::purge_old() {
  if (context_.options.keep_deleted.count() == 0) return;
  context_.store->run_on_strand([this, now = context_.wall()](Store& store) {
    for (const DeletedMap& map : store.deleted_maps()) {
      if (map.problem || now - map.deleted < context_.options.keep_deleted)
        continue;  // what may be read again tomorrow stays
      const Status purged = store.purge(map.header.id);
      if (!purged) context_.log->error("{}, deleted long ago: {}", map.header.name, purged.error().message);
      if (!purged) continue;
      context_.post([this, id = map.header.id, name = map.header.name] {
        places_.forget_overlaps(id);
        context_.site.forget(id, name);
        context_.log->info("{} ({}) was deleted long ago and is purged", name, to_hex(id.bytes));
        context_.site.note({0, context_.site.policy()->now(), "server", "purge", "map " + name, "done"});
      });
    }
  });
}

void MapAdministration::take_in(MapId id, MapOpening::Undo undo, const AdminAnswer& answer) {
  const auto serve = [this, id, undo, answer](Result<RestoredMap> restored) {
    health_.look_again();
    if (!restored) return context_.post(telling(answer, refusal(restored.error())));
    const std::string name = restored->header.name;
    try {
      context_.post([this, undo, answer, map = maps_.prepare(std::move(*restored))]() mutable {
        serve_anew(std::move(map), undo, answer);
      });
    } catch (const std::exception& problem) {  // memory
      const std::string why = std::string("cannot be served: ") + problem.what();
      context_.store->opening().take_back(id, name, undo, why);
      context_.post(telling(answer, refusal(ErrorCode::kRefused, "the map " + why)));
    }
  };
  context_.store->opening().restore_one(id, context_.options.opening(),
                                        restored_images(context_.options.idle_after), undo, serve);
}

void MapAdministration::serve_anew(ResumedMap map, MapOpening::Undo undo, const AdminAnswer& answer) {
  const MapId id = map.header.id;
  const std::string old_name = map.header.name;
  const std::string name = maps_.array().names().free(old_name);
  map.header.name = name;  // no two are called the same, however long it takes to keep that
  maps_.take_up(std::move(map));
  const auto runner = maps_.array().find(id)->runner;
  const auto done = [this, id, old_name, undo, runner, answer](const Status& kept) {
    if (!kept) {
      runner->retire();
      context_.store->run([this, id, old_name, undo, why = kept.error().message](Store&) {
        context_.store->opening().take_back(id, old_name, undo, why);
      });
    }
    context_.post([this, id, answer, kept] {
      const MapEntry* entry = maps_.array().find(id);
      if (!kept) maps_.forget(id);
      if (!kept) return answer(refusal(kept.error()));
      if (entry == nullptr) return answer(refusal(ErrorCode::kNotFound, "the map has gone meanwhile"));
      answer(overview_.describe(id, *entry));
    });
  };
  if (name == old_name) return done({});
  runner->rename(name, done);
}

}  // namespace cairn
