// SPDX-License-Identifier: Apache-2.0
#include "server/service/store_administration.h"

#include <optional>
#include <utility>

#include "server/access/rights_file.h"
#include "server/service/store_tasks.h"
#include "server/store/backup.h"
#include "server/store/store_check.h"

namespace cairn {
namespace {

constexpr size_t kMostBackingUp = 64;

/// Id of the map whose file a part of the store is, if it is one of those in use; nothing for other parts.
std::optional<MapId> map_of(const std::string& part) {
  constexpr std::string_view kMaps = "maps/";
  if (!is_backup_part(part) || !part.starts_with(kMaps)) return std::nullopt;
  const auto bytes = from_hex(part.substr(kMaps.size(), 32));
  return bytes ? std::optional(MapId{*bytes}) : std::nullopt;
}

/// Whether a part has gone since the files were listed.
bool has_gone(const std::filesystem::path& folder, const std::string& part) {
  std::error_code ignored;
  return is_backup_part(part) && !std::filesystem::exists(folder / part, ignored);
}

Status check_rights(const std::string& text) {
  const auto rights = read_rights(text);
  return rights ? Status() : tl::unexpected(rights.error());
}

}  // namespace

void StoreAdministration::take(const std::string& operator_name, const asked::Backup& ask,
                               const AdminAnswer& answer) {
  if (backing_up_.size() >= kMostBackingUp) backing_up_.clear();
  backing_up_.insert(operator_name);
  list_parts(ask.after, answer);
}

void StoreAdministration::take(const asked::Verify& ask, const AdminAnswer& answer) {
  list_parts(ask.after, answer);
}

void StoreAdministration::list_parts(const std::string& after, const AdminAnswer& answer) {
  on_store_strand(context_, answer, [after, answer](const Store& store) -> Task {
    return [answer, after, parts = parts_of_store(store.folder())] {
      if (!parts) return answer(refusal(parts.error()));
      told::Parts page;  // the one that it begins beyond may have gone meanwhile
      for (const std::string& part : *parts)
        if (after.empty() || comes_later(part, after)) page.parts.push_back(part);
      answer(std::move(page));
    };
  });
}

void StoreAdministration::take(const asked::VerifyPart& ask, const AdminAnswer& answer) {
  if (context_.store == nullptr) return answer(refusal(ErrorCode::kRefused, kNoStore));
  context_.store->run_examination([this, part = ask.part, answer](const std::filesystem::path& folder) {
    const FileCheck check = check_part(folder, part, check_rights, FileInUse::kYes);
    const bool is_gone = !check.faults.empty() && has_gone(folder, part);
    context_.post([answer, is_gone, check] { is_gone ? answer(told::GonePart{}) : answer(check); });
  });
}

void StoreAdministration::take(const std::string& operator_name, const asked::BackupPart& ask,
                               const AdminAnswer& answer) {
  if (!backing_up_.contains(operator_name))
    return answer(refusal(ErrorCode::kRefused, "no backup of yours is under way; begin it anew"));
  const auto copy = [this, part = ask.part, answer](const Store& store) -> Task {
    const auto copied = archives_.hand_out(
        [&](const std::filesystem::path& path) { return copy_part(store.folder(), part, path); });
    if (copied) return telling(answer, *copied);
    return telling(answer, has_gone(store.folder(), part) ? told::GonePart() : refusal(copied.error()));
  };
  const auto map = map_of(ask.part);
  const auto entry = map ? maps_.all().find(*map) : maps_.all().end();
  if (entry == maps_.all().end() || entry->second.runner == nullptr || context_.store == nullptr)
    return on_store_strand(context_, answer, copy);
  on_store_strand_when_kept(context_, *entry->second.runner, answer, copy);
}

}  // namespace cairn
