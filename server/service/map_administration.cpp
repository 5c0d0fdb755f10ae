// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <nlohmann/json.hpp>
#include <utility>

#include "server/service/admin_reply.h"
#include "server/service/map_service.h"

/// What operators do to maps. The store's part is done beside its writer, so that no verdict waits for it.
namespace cairn {
namespace {

using nlohmann::json;

constexpr const char* kMadeElsewhere = "this map is made elsewhere";

/// Those that an operator may mean by a name or an id, the latest deleted first.
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

void MapService::with_store(const AdminAnswer& answer, std::function<Task(Store& store)> work) {
  if (store_ == nullptr) return answer(refusal(ErrorCode::kRefused, kNoStore));
  store_->run_beside([this, answer, work = std::move(work)](Store& store) {
    Task next;
    try {
      next = work(store);
    } catch (const std::exception& problem) {
      log_->error("internal error in an operator's request: {}", problem.what());
      next = [answer] {
        answer(refusal(ErrorCode::kInternal, "internal error; the server's log says more"));
      };
    }
    if (next) post_(std::move(next));
  });
}

void MapService::rename_map(MapId id, MapEntry* entry, const std::string& name, const AdminAnswer& answer) {
  if (!is_valid_name(name))
    return answer(refusal(ErrorCode::kUsage, "name '" + name + "': expected 1 to 32 of a-z, 0-9 and -"));
  if (entry->name == name) return answer(success(describe_map(id, *entry)));
  if (!maps_.is_free(name))
    return answer(refusal(ErrorCode::kRefused, "another map is called '" + name + "'"));
  if (entry->runner == nullptr) return answer(refusal(ErrorCode::kRefused, kMadeElsewhere));
  if (!entry->name_to_be.empty())
    return answer(refusal(ErrorCode::kRefused, "the map is being renamed by another; try again"));
  if (entry->rolling_back) return answer(refusal(ErrorCode::kRefused, kRollingBack));
  maps_.begin_renaming(entry, name);
  young_.forget(id);
  entry->runner->rename(name, [this, id, answer](const Status& kept) {
    post_([this, id, answer, kept] {
      MapEntry* renamed = maps_.find(id);
      if (renamed == nullptr) return answer(refusal(ErrorCode::kNotFound, "the map has gone meanwhile"));
      maps_.end_renaming(renamed, kept.has_value());
      if (!kept) return answer(refusal(kept.error()));
      list_map(id, *renamed);
      answer(success(describe_map(id, *renamed)));
    });
  });
}

void MapService::delete_map(MapId id, MapEntry* entry, bool for_good, const AdminAnswer& answer) {
  if (entry->runner == nullptr) return answer(refusal(ErrorCode::kRefused, kMadeElsewhere));
  if (store_ == nullptr && !for_good) {
    return answer(refusal(ErrorCode::kRefused,
                          "this server keeps nothing (no --store): the map could not be had back; "
                          "--for-good deletes it all the same"));
  }
  if (store_ != nullptr && for_good) {
    return answer(refusal(ErrorCode::kUsage,
                          "a deleted map can be had back from this server until `cairnctl maps purge`; "
                          "delete it without --for-good"));
  }
  if (store_ == nullptr) {
    entry->runner->retire();
    return finish_deletion(id, {}, answer);
  }
  if (entry->rolling_back) return answer(refusal(ErrorCode::kRefused, kRollingBack));
  entry->leaving = true;
  // All that is handed in is written, exports of it that are under way come to their end, and then its file
  // goes, in the writer's turn. Until then the map is served: it may yet stay.
  const auto remove = [this, id, runner = entry->runner, answer](Store& store) {
    const Status removed = store.remove(id);
    if (removed) runner->retire();
    post_([this, id, removed, answer] { finish_deletion(id, removed, answer); });
  };
  entry->runner->flush([this, answer, remove](const Status&) {  // a full disk keeps no map from going
    store_->run([this, answer, remove](const Store&) {
      with_store(answer, [this, remove](const Store&) -> Task {
        store_->run(remove);
        return {};
      });
    });
  });
}

void MapService::finish_deletion(MapId id, const Status& removed, const AdminAnswer& answer) {
  MapEntry* entry = maps_.find(id);
  if (entry == nullptr) return answer(success({{"id", to_hex(id.bytes)}}));  // by another operator meanwhile
  if (!removed) {
    entry->leaving = false;
    return answer(refusal(removed.error()));
  }
  const json deleted = describe(id, *entry);
  forget_map(id);
  if (store_ == nullptr) overlaps_.forget(id);
  answer(success(deleted));
}

void MapService::drop_dead_maps(MonotonicTime now) {
  if (options_.drop_after.count() == 0) return;
  for (const YoungMaps::Dead& dead : young_.dead(now, options_.drop_after)) {
    MapEntry* entry = maps_.find(dead.map);
    if (entry != nullptr && (entry->seeding || entry->offers_in_work > 0)) continue;  // it may yet be of use
    young_.forget(dead.map);
    if (entry == nullptr || entry->leaving || entry->rolling_back || !entry->frozen.empty()) continue;
    const std::string id = to_hex(dead.map.bytes);
    log_->info("{} is dropped: {} lost it after {:.1f} s, and nobody has been found in it since{}",
               entry->name, dead.maker, std::chrono::duration<double>(dead.tracked).count(),
               store_ == nullptr ? "" : "; `cairnctl map " + id + " undelete` puts it back");
    const bool for_good = store_ == nullptr;
    delete_map(dead.map, entry, for_good, [log = log_, name = entry->name](const wire::AdminReply& reply) {
      if (reply.result != 0) log->warn("{} could not be dropped: {}", name, reply.text);
    });
  }
}

void MapService::answer_without_map(const std::string& verb, const std::string& wanted,
                                    const AdminAnswer& answer) {
  if (store_ == nullptr) return answer(unknown_map(wanted));
  with_store(answer, [verb, wanted, answer](const Store& store) -> Task {
    const std::vector<DeletedMap> maps = deleted_maps_called(store, wanted);
    const auto reply = [&] {
      if (maps.empty()) return unknown_map(wanted);
      if (verb == "delete") return success(describe(maps.front()));
      if (maps.size() > 1) return refusal(ambiguous(wanted, maps, ""));
      return maps.front().problem ? refusal(maps.front()) : deleted_map(wanted);
    };
    return [answer, said = reply()] { answer(said); };
  });
}

void MapService::undelete_map(const std::string& wanted, const AdminAnswer& answer) {
  const auto [id, entry] = find_map(wanted);
  const bool is_live = entry != nullptr;
  const json live = is_live ? describe_map(id, *entry) : json();
  const std::string full = why_full();
  with_store(answer, [this, wanted, answer, is_live, live, full](Store& store) -> Task {
    const std::vector<DeletedMap> maps = deleted_maps_called(store, wanted);
    const auto say = [answer](const wire::AdminReply& reply) -> Task {
      return [answer, reply] { answer(reply); };
    };
    if (maps.empty() && is_live) return say(success(live));
    if (maps.empty()) return say(refusal(ErrorCode::kNotFound, "no deleted map '" + wanted + "'"));
    if (maps.size() > 1 || is_live) {
      const std::string in_use = is_live ? fmt::format(" {} (in use)", live.value("id", "")) : std::string();
      return say(refusal(ambiguous(wanted, maps, in_use)));
    }
    if (maps[0].problem) return say(refusal(maps[0]));
    if (!full.empty()) return say(refusal(ErrorCode::kRefused, full));
    if (const Status back = store.undelete(maps[0].header.id); !back) return say(refusal(back.error()));
    take_in(maps[0].header.id, &Store::undo_undelete, answer);
    return {};
  });
}

void MapService::purge_map(const std::string& wanted, const AdminAnswer& answer) {
  with_store(answer, [this, wanted, answer](Store& store) -> Task {
    const std::vector<DeletedMap> maps = deleted_maps_called(store, wanted);
    const auto say = [answer](const wire::AdminReply& reply) -> Task {
      return [answer, reply] { answer(reply); };
    };
    if (maps.empty()) return say(refusal(ErrorCode::kNotFound, "no deleted map '" + wanted + "'"));
    if (maps.size() > 1) return say(refusal(ambiguous(wanted, maps, "")));
    // Not by mistake what can be read again tomorrow.
    if (maps[0].problem && maps[0].problem->code != ErrorCode::kDamaged) return say(refusal(maps[0]));
    const Status purged = store.purge(maps[0].header.id);
    if (!purged) return say(refusal(purged.error()));
    return [this, answer, map = maps[0]] {
      overlaps_.forget(map.header.id);
      answer(success(describe(map)));
    };
  });
}

void MapService::purge_old_maps() {
  if (options_.keep_deleted.count() == 0) return;
  store_->run_beside([this, now = clock_.wall()](Store& store) {
    for (const DeletedMap& map : store.deleted_maps()) {
      if (map.problem || now - map.deleted < options_.keep_deleted)
        continue;  // what may be read again tomorrow stays
      const Status purged = store.purge(map.header.id);
      if (!purged) log_->error("{}, deleted long ago: {}", map.header.name, purged.error().message);
      if (!purged) continue;
      post_([this, id = map.header.id, name = map.header.name] {
        overlaps_.forget(id);
        log_->info("{} ({}) was deleted long ago and is purged", name, to_hex(id.bytes));
        site_.note({0, site_.policy()->now(), "server", "purge", "map " + name, "done"});
      });
    }
  });
}

void MapService::take_in(MapId id, MapPersistence::Undo undo, const AdminAnswer& answer) {
  const auto serve = [this, id, undo, answer](Result<RestoredMap> restored) {
    look_for_damage();
    if (!restored) return post_([answer, error = restored.error()] { answer(refusal(error)); });
    const std::string name = restored->header.name;
    try {
      post_([this, undo, answer, map = prepare(std::move(*restored))]() mutable {
        serve_anew(std::move(map), undo, answer);
      });
    } catch (const std::exception& problem) {  // memory
      const std::string why = std::string("cannot be served: ") + problem.what();
      store_->take_back(id, name, undo, why);
      post_([answer, why] { answer(refusal(ErrorCode::kRefused, "the map " + why)); });
    }
  };
  store_->restore_one(id, options_.mapping, restored_images(options_.rest_after), undo, serve);
}

void MapService::serve_anew(ResumedMap map, MapPersistence::Undo undo, const AdminAnswer& answer) {
  const MapId id = map.header.id;
  const std::string old_name = map.header.name;
  const std::string name = maps_.free_name(old_name);
  map.header.name = name;  // no two are called the same, however long it takes to keep that
  take_up(std::move(map));
  const auto runner = maps_.find(id)->runner;
  const auto done = [this, id, old_name, undo, runner, answer](const Status& kept) {
    if (!kept) {
      runner->retire();
      store_->run([this, id, old_name, undo, why = kept.error().message](Store&) {
        store_->take_back(id, old_name, undo, why);
      });
    }
    post_([this, id, answer, kept] {
      const MapEntry* entry = maps_.find(id);
      if (!kept) forget_map(id);
      if (!kept) return answer(refusal(kept.error()));
      if (entry == nullptr) return answer(refusal(ErrorCode::kNotFound, "the map has gone meanwhile"));
      answer(success(describe_map(id, *entry)));
    });
  };
  if (name == old_name) return done({});
  runner->rename(name, done);
}

void MapService::export_map(MapId id, const MapEntry* entry, const AdminAnswer& answer) {
  if (entry->runner == nullptr) return answer(refusal(ErrorCode::kRefused, kMadeElsewhere));
  if (store_ == nullptr) return answer(refusal(ErrorCode::kRefused, kNoStore));
  if (entry->leaving) return answer(refusal(ErrorCode::kRefused, "the map is being deleted"));
  const auto copy = [this, id, name = entry->name, answer](const Store& store) -> Task {
    const auto token = transfers_->begin_export(clock_.now());
    if (!token) return [answer, error = token.error()] { answer(refusal(error)); };
    const std::filesystem::path path = *transfers_->find(*token, clock_.now());
    const Status exported = store.export_map(id, path);
    if (!exported) {
      transfers_->end(*token);
      return [answer, error = exported.error()] { answer(refusal(error)); };
    }
    const json archive{{"token", *token},
                       {"bytes", std::filesystem::file_size(path)},
                       {"name", name},
                       {"id", to_hex(id.bytes)}};
    return [answer, archive] { answer(success(archive)); };
  };
  // What was handed to the writer is in the file once a task of its own has come to its turn.
  entry->runner->flush([this, answer, copy](const Status& kept) {
    if (!kept) return post_([answer, error = kept.error()] { answer(refusal(error)); });
    store_->run([this, answer, copy](const Store&) { with_store(answer, copy); });
  });
}

void MapService::transfer(const std::string& verb, const std::string& token, uint64_t offset,
                          std::vector<uint8_t> data, const AdminAnswer& answer) {
  with_store(answer, [this, verb, token, offset, data = std::move(data), answer](const Store&) -> Task {
    const MonotonicTime now = clock_.now();
    wire::AdminReply reply = success(json::object());
    if (verb == "export-read") {
      auto piece = transfers_->read(token, offset, wire::kMaxAdminData, now);
      if (piece) {
        reply.data = std::move(*piece);
      } else {
        reply = refusal(piece.error());
      }
    } else {
      const Status done = verb == "import-begin" ? transfers_->begin_import(token, now)
                                                 : transfers_->write(token, offset, data, now);
      if (!done) reply = refusal(done.error());
    }
    return [answer, reply = std::move(reply)] { answer(reply); };
  });
}

void MapService::import_map(const std::string& token, const AdminAnswer& answer) {
  const size_t used = maps_.bytes();
  const uint64_t room = options_.max_memory_bytes - std::min(used, options_.max_memory_bytes);
  with_store(answer, [this, token, full = why_full(), room, answer](Store& store) -> Task {
    const auto refuse = [this, token, answer](const Error& error) -> Task {
      transfers_->end(token);
      return [answer, error] { answer(refusal(error)); };
    };
    const auto path = transfers_->find(token, clock_.now());
    if (!path) return refuse(path.error());
    if (!full.empty()) return refuse({ErrorCode::kRefused, full});
    // What is not pictures is about as large in memory; those are packed in there.
    std::error_code problem;
    const uintmax_t bytes = std::filesystem::file_size(*path, problem);
    if (problem) return refuse({ErrorCode::kIo, path->string() + ": cannot be read: " + problem.message()});
    if (bytes > room)
      return refuse(
          {ErrorCode::kRefused, "the archive does not fit into the server's memory (--max-memory)"});
    const auto imported = store.import_map(*path, room);
    if (!imported) return refuse(imported.error());
    transfers_->end(token);
    take_in(*imported, &Store::undo_import, answer);
    return {};
  });
}

}  // namespace cairn
