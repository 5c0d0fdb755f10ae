// SPDX-License-Identifier: Apache-2.0
#include "server/service/archives.h"

#include <utility>

#include "server/service/store_tasks.h"

namespace cairn {

Archives::Archives(const ServiceContext& context, const Capacity& capacity, MapAdministration& maps)
    : context_(context),
      capacity_(capacity),
      maps_(maps),
      transfers_(context.store == nullptr
                     ? nullptr
                     : std::make_shared<Transfers>(context.store->folder() / "transfer")) {}

Result<told::Copy> Archives::hand_out(const std::function<Status(const std::filesystem::path& to)>& copy) {
  const auto token = transfers_->begin_export(context_.now());
  if (!token) return tl::unexpected(token.error());
  const std::filesystem::path path = *transfers_->find(*token, context_.now());
  if (const Status copied = copy(path); !copied) {
    transfers_->end(*token);
    return tl::unexpected(copied.error());
  }
  return told::Copy{*token, std::filesystem::file_size(path)};
}

void Archives::export_map(MapId id, const MapEntry& entry, const AdminAnswer& answer) {
  if (entry.runner == nullptr) return answer(refusal(ErrorCode::kRefused, kMadeElsewhere));
  if (context_.store == nullptr) return answer(refusal(ErrorCode::kRefused, kNoStore));
  if (entry.leaving) return answer(refusal(ErrorCode::kRefused, "the map is being deleted"));
  const auto copy = [this, id, name = entry.name, answer](const Store& store) -> Task {
    const auto archive =
        hand_out([&](const std::filesystem::path& path) { return store.export_map(id, path); });
    if (!archive) return telling(answer, refusal(archive.error()));
    return telling(answer, told::Archive{*archive, name, id});
  };
  on_store_strand_when_kept(context_, *entry.runner, answer, copy);
}

void Archives::read(const asked::ExportRead& piece, const AdminAnswer& answer) {
  on_store_strand(context_, answer, [this, piece, answer](const Store&) -> Task {
    auto data = transfers_->read(piece.token, piece.offset, wire::kMaxAdminData, context_.now());
    if (!data) return telling(answer, refusal(data.error()));
    return telling(answer, told::Piece{std::move(*data)});
  });
}

void Archives::begin_import(const asked::ImportBegin& ask, const AdminAnswer& answer) {
  on_store_strand(context_, answer, [this, ask, answer](const Store&) -> Task {
    const Status begun = transfers_->begin_import(ask.token, context_.now());
    return telling(answer, begun ? told::Nothing() : refusal(begun.error()));
  });
}

void Archives::write(const asked::ImportWrite& piece, std::vector<uint8_t> data, const AdminAnswer& answer) {
  on_store_strand(context_, answer, [this, piece, data = std::move(data), answer](const Store&) -> Task {
    const Status written = transfers_->write(piece.token, piece.offset, data, context_.now());
    return telling(answer, written ? told::Nothing() : refusal(written.error()));
  });
}

void Archives::import_map(const asked::Import& ask, const AdminAnswer& answer) {
  const auto take = [this, token = ask.token, full = capacity_.why_full(), room = capacity_.free_bytes(),
                     answer](Store& store) -> Task {
    const auto refuse = [this, token, answer](const Error& error) -> Task {
      transfers_->end(token);
      return telling(answer, refusal(error));
    };
    const auto path = transfers_->find(token, context_.now());
    if (!path) return refuse(path.error());
    if (!full.empty()) return refuse({ErrorCode::kRefused, full});
    // What is not images is about as large in memory; those are packed in there.
    std::error_code problem;
    const uintmax_t bytes = std::filesystem::file_size(*path, problem);
    if (problem) return refuse({ErrorCode::kIo, path->string() + ": cannot be read: " + problem.message()});
    if (bytes > room)
      return refuse(
          {ErrorCode::kRefused, "the archive does not fit into the server's memory (--max-memory)"});
    const auto imported = store.import_map(*path, room);
    if (!imported) return refuse(imported.error());
    transfers_->end(token);
    maps_.take_in(*imported, &Store::undo_import, answer);
    return {};
  };
  on_store_strand(context_, answer, take);
}

void Archives::expire() {
  context_.store->run_on_strand(
      [transfers = transfers_, clock = context_.options.clock](Store&) { transfers->expire(clock->now()); });
}

}  // namespace cairn
