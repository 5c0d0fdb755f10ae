// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/version.h"
#include "common/wire/partition.h"
#include "server/service/switchboard.h"

/// What operators ask for (idl/README.md, AdminRequest).
namespace cairn {
namespace {

using nlohmann::json;

constexpr size_t kMaxOperators = 16;
constexpr uint64_t kMaxArchiveBytes = uint64_t{1} << 34;

json describe(MapId id, const MapEntry& entry) {
  return {{"id", to_hex(id.bytes)},
          {"name", entry.name},
          {"keyframes", entry.snapshot->keyframe_count()},
          {"points", entry.snapshot->point_count()},
          {"epoch", entry.snapshot->epoch.value},
          {"revision", entry.snapshot->revision.value},
          {"memory_bytes", entry.statistics.bytes},
          {"reprojection_px", entry.statistics.mean_reprojection},
          {"plane_aligned", entry.plane_aligned}};
}

json describe_deleted(const MapHeader& header) {
  return {{"id", to_hex(header.id.bytes)}, {"name", header.name}};
}

wire::AdminReply refusal(const Error& error) {
  wire::AdminReply reply;
  // Whatever else it is to us, to the operator it is the server's no.
  const bool own_words = error.code == ErrorCode::kUsage || error.code == ErrorCode::kDamaged;
  reply.result = static_cast<uint8_t>(exit_code(own_words ? error.code : ErrorCode::kRefused));
  reply.text = error.message;
  return reply;
}

wire::AdminReply refusal(ErrorCode code, std::string message) {
  return refusal(Error{code, std::move(message)});
}

wire::AdminReply success(const json& content) {
  wire::AdminReply reply;
  reply.text = content.dump();
  return reply;
}

/// A member of a request that must be a text.
std::string text_of(const json& request, const char* key) {
  const auto it = request.find(key);
  return it != request.end() && it->is_string() ? it->get<std::string>() : std::string();
}

uint64_t number_of(const json& request, const char* key) {
  const auto it = request.find(key);
  return it != request.end() && it->is_number_unsigned() ? it->get<uint64_t>() : 0;
}

/// A file on its way to or from an operator, within the store's folder. Tokens are ours, not paths.
std::optional<std::filesystem::path> transfer_path(const std::filesystem::path& folder,
                                                   const std::string& token) {
  if (!is_valid_name(token)) return std::nullopt;
  return folder / "transfer" / token;
}

wire::AdminReply read_chunk(const std::filesystem::path& path, uint64_t offset) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return refusal(ErrorCode::kNotFound, "no such transfer; begin it anew");
  in.seekg(static_cast<std::streamoff>(offset));
  wire::AdminReply reply = success(json::object());
  reply.data.resize(wire::kMaxAdminData);
  in.read(reinterpret_cast<char*>(reply.data.data()), static_cast<std::streamsize>(wire::kMaxAdminData));
  reply.data.resize(static_cast<size_t>(in.gcount()));
  return reply;
}

/// Writes at an offset, so a chunk that comes twice does no harm.
wire::AdminReply write_chunk(const std::filesystem::path& path, uint64_t offset,
                             const std::vector<uint8_t>& data) {
  if (offset + data.size() > kMaxArchiveBytes)
    return refusal(ErrorCode::kRefused, "too large for an archive");
  std::fstream out(path, std::ios::binary | std::ios::in | std::ios::out);
  if (!out) return refusal(ErrorCode::kNotFound, "no such transfer; begin it anew");
  out.seekp(static_cast<std::streamoff>(offset));
  out.write(reinterpret_cast<const char*>(data.data()), static_cast<std::streamsize>(data.size()));
  out.close();
  if (!out) return refusal(ErrorCode::kIo, path.string() + ": cannot be written; is the disk full?");
  return success(json::object());
}

}  // namespace

void Switchboard::on_admin(const std::string& operator_name, const wire::AdminRequest& message) {
  Operator* asking = operator_of(operator_name);
  if (asking == nullptr) return;
  if (asking->last && asking->last->command == message.command) {
    report(asking->replies.write(*asking->last), "AdminReply");  // sent again: the answer was lost
    return;
  }
  if (asking->in_work == message.command) return;
  asking->in_work = message.command;
  const auto answer = [this, operator_name, command = message.command](wire::AdminReply reply) {
    reply.command = command;
    on_admin_answered(operator_name, std::move(reply));
  };
  const json request = json::parse(message.request, nullptr, false);
  if (!request.is_object()) return answer(refusal(ErrorCode::kUsage, "a request that is no JSON object"));
  const std::string verb = text_of(request, "verb");
  log_->info("operator {}: {}", operator_name, message.request.substr(0, 200));
  if (verb == "status") return describe_server(answer);
  if (verb == "maps") return list_maps(answer);
  if (verb == "undelete") return undelete_map(text_of(request, "map"), answer);
  if (verb == "import-begin" || verb == "import-write" || verb == "import" || verb == "export-read")
    return transfer(verb, text_of(request, "token"), number_of(request, "offset"), message.data, answer);

  const std::string wanted = text_of(request, "map");
  const auto [id, entry] = find_map(wanted);
  if (entry == nullptr && verb == "delete") return delete_again(wanted, answer);
  if (entry == nullptr) return answer(refusal(ErrorCode::kNotFound, "no map '" + wanted + "'"));
  if (verb == "show") return answer(success(describe(id, *entry)));
  if (verb == "rename") return rename_map(id, entry, text_of(request, "name"), answer);
  if (verb == "delete") return delete_map(id, entry, answer);
  if (verb == "export") return export_map(id, entry, answer);
  answer(refusal(ErrorCode::kUsage, "this server does not know '" + verb + "'"));
}

void Switchboard::on_admin_answered(const std::string& operator_name, wire::AdminReply reply) {
  Operator* asking = operator_of(operator_name);
  if (asking == nullptr) return;
  reply.operator_id = client_id_from_name(operator_name);
  report(asking->replies.write(reply), "AdminReply");
  asking->last = std::move(reply);
}

Switchboard::Operator* Switchboard::operator_of(const std::string& name) {
  const auto known = operators_.find(name);
  if (known != operators_.end()) return &known->second;
  if (operators_.size() >= kMaxOperators) operators_.erase(operators_.begin());
  auto replies = wire::Writer<wire::AdminReply>::create(participant_, wire::operator_partition(name));
  if (!replies) {
    log_->error("operator {} cannot be answered: {}", name, replies.error().message);
    return nullptr;
  }
  return &operators_.emplace(name, Operator{std::move(*replies), {}, {}}).first->second;
}

std::pair<MapId, MapEntry*> Switchboard::find_map(const std::string& name_or_id) {
  for (const auto& [id, entry] : maps_.all()) {
    if (entry.snapshot != nullptr && (entry.name == name_or_id || to_hex(id.bytes) == name_or_id))
      return {id, maps_.find(id)};
  }
  return {};
}

void Switchboard::describe_server(const AdminAnswer& answer) {
  json clients = json::array();
  for (const auto& [name, client] : clients_) {
    if (client.writers) clients.push_back(name);
  }
  answer(success({{"server", to_hex(options_.server.bytes)},
                  {"version", std::string(version())},
                  {"start_count", options_.start_count},
                  {"health", health()},
                  {"store", store_ ? store_->folder().string() : std::string()},
                  {"maps", maps_.live_count()},
                  {"memory_bytes", maps_.bytes()},
                  {"clients", std::move(clients)}}));
}

void Switchboard::list_maps(const AdminAnswer& answer) {
  json maps = json::array();
  for (const auto& [id, entry] : maps_.all()) {
    if (entry.snapshot != nullptr) maps.push_back(describe(id, entry));
  }
  json list{{"maps", std::move(maps)}, {"deleted", json::array()}};
  if (store_ == nullptr) return answer(success(list));
  store_->run([this, answer, list = std::move(list)](const Store& store) mutable {
    for (const MapHeader& header : store.deleted_maps()) list["deleted"].push_back(describe_deleted(header));
    post([answer, list = std::move(list)] { answer(success(list)); });
  });
}

void Switchboard::rename_map(MapId id, MapEntry* entry, const std::string& name, const AdminAnswer& answer) {
  if (!is_valid_name(name))
    return answer(refusal(ErrorCode::kUsage, "name '" + name + "': expected 1 to 32 of a-z, 0-9 and -"));
  if (entry->name == name) return answer(success(describe(id, *entry)));
  if (find_map(name).second != nullptr)
    return answer(refusal(ErrorCode::kRefused, "another map is called '" + name + "'"));
  if (entry->runner == nullptr) return answer(refusal(ErrorCode::kRefused, "this map is made elsewhere"));
  const std::string before = std::exchange(entry->name, name);
  entry->runner->rename(name, [this, id, before, answer](const Status& kept) {
    post([this, id, before, answer, kept] {
      MapEntry* renamed = maps_.find(id);
      if (renamed == nullptr) return answer(refusal(ErrorCode::kNotFound, "the map has gone meanwhile"));
      if (!kept) {
        renamed->name = before;
        renamed->runner->rename(before, [](const Status&) {});
        return answer(refusal(kept.error()));
      }
      tell_all(make_map_info(options_.server, id, *renamed));
      answer(success(describe(id, *renamed)));
    });
  });
}

void Switchboard::delete_map(MapId id, const MapEntry* entry, const AdminAnswer& answer) {
  if (entry->runner == nullptr) return answer(refusal(ErrorCode::kRefused, "this map is made elsewhere"));
  entry->runner->flush([this, id, answer] { post([this, id, answer] { finish_deletion(id, answer); }); });
}

void Switchboard::finish_deletion(MapId id, const AdminAnswer& answer) {
  const MapEntry* entry = maps_.find(id);
  if (entry == nullptr) return answer(success({{"id", to_hex(id.bytes)}}));
  const json deleted = describe(id, *entry);
  entry->runner->stop();
  maps_.remove(id);
  places_->remove(id);
  info_due_.erase(id);
  {
    const std::scoped_lock lock(mutex_);
    published_.erase(id);
  }
  wire::MapInfo gone;
  gone.map = id;
  for (auto& [name, client] : clients_) {
    client.feeds.erase(id);
    if (client.writers) report(client.writers->maps.dispose(gone), "MapInfo");
  }
  if (store_ == nullptr) return answer(success(deleted));
  store_->run([this, id, answer, deleted](Store& store) {
    const Status removed = store.remove(id);
    post([answer, deleted, removed] { answer(removed ? success(deleted) : refusal(removed.error())); });
  });
}

void Switchboard::delete_again(const std::string& wanted, const AdminAnswer& answer) {
  if (store_ == nullptr) return answer(refusal(ErrorCode::kNotFound, "no map '" + wanted + "'"));
  store_->run([this, wanted, answer](const Store& store) {
    wire::AdminReply reply = refusal(ErrorCode::kNotFound, "no map '" + wanted + "'");
    for (const MapHeader& header : store.deleted_maps()) {
      if (header.name == wanted || to_hex(header.id.bytes) == wanted)
        reply = success(describe_deleted(header));
    }
    post([answer, reply] { answer(reply); });
  });
}

void Switchboard::undelete_map(const std::string& wanted, const AdminAnswer& answer) {
  if (const auto [id, entry] = find_map(wanted); entry != nullptr)
    return answer(success(describe(id, *entry)));
  if (store_ == nullptr) return answer(refusal(ErrorCode::kRefused, kNoStore));
  store_->run([this, wanted, answer](Store& store) {
    for (const MapHeader& header : store.deleted_maps()) {
      if (header.name != wanted && to_hex(header.id.bytes) != wanted) continue;
      const Status back = store.undelete(header.id);
      if (!back) return post([answer, back] { answer(refusal(back.error())); });
      return take_in(header.id, answer);
    }
    post([answer, wanted] { answer(refusal(ErrorCode::kNotFound, "no deleted map '" + wanted + "'")); });
  });
}

void Switchboard::take_in(MapId id, const AdminAnswer& answer) {
  auto restored = std::make_shared<Result<RestoredMap>>(store_->restore_one(id, options_.mapping));
  post([this, id, answer, restored] {
    if (!*restored) return answer(refusal(restored->error()));
    const std::string name = maps_.free_name((*restored)->header.name);
    const bool renamed = name != (*restored)->header.name;
    resume_map(std::move(**restored));
    run_posted();  // its first revision
    MapEntry* entry = maps_.find(id);
    if (renamed) return rename_map(id, entry, name, answer);
    answer(success(describe(id, *entry)));
  });
}

void Switchboard::export_map(MapId id, const MapEntry* entry, const AdminAnswer& answer) {
  if (store_ == nullptr) return answer(refusal(ErrorCode::kRefused, kNoStore));
  if (entry->runner == nullptr) return answer(refusal(ErrorCode::kRefused, "this map is made elsewhere"));
  entry->runner->flush([this, id, name = entry->name, answer] {
    store_->run([this, id, name, answer](Store& store) {
      const std::string token = "export-" + to_hex(id.bytes).substr(0, 24);
      const std::filesystem::path path = *transfer_path(store.folder(), token);
      std::filesystem::remove(path);
      const Status exported = store.export_map(id, path);
      wire::AdminReply reply = exported ? success({{"token", token},
                                                   {"bytes", std::filesystem::file_size(path)},
                                                   {"name", name},
                                                   {"id", to_hex(id.bytes)}})
                                        : refusal(exported.error());
      post([answer, reply = std::move(reply)] { answer(reply); });
    });
  });
}

void Switchboard::transfer(const std::string& verb, const std::string& token, uint64_t offset,
                           const std::vector<uint8_t>& data, const AdminAnswer& answer) {
  if (store_ == nullptr) return answer(refusal(ErrorCode::kRefused, kNoStore));
  const auto path = transfer_path(store_->folder(), token);
  if (!path) return answer(refusal(ErrorCode::kUsage, "'" + token + "' is not a transfer"));
  if (verb == "export-read") return answer(read_chunk(*path, offset));
  if (verb == "import-begin") {
    std::ofstream(*path, std::ios::binary | std::ios::trunc);
    return answer(success(json::object()));
  }
  if (verb == "import-write") return answer(write_chunk(*path, offset, data));
  store_->run([this, path = *path, answer](Store& store) {
    const auto imported = store.import_map(path);
    std::filesystem::remove(path);
    if (!imported) return post([answer, error = imported.error()] { answer(refusal(error)); });
    take_in(*imported, answer);
  });
}

}  // namespace cairn
