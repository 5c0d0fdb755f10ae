// SPDX-License-Identifier: Apache-2.0
#include <nlohmann/json.hpp>
#include <utility>

#include "server/access/rights_file.h"
#include "server/service/admin_reply.h"
#include "server/service/admin_request.h"
#include "server/service/map_service.h"
#include "server/store/backup.h"
#include "server/store/store_check.h"

/// Backup and verification of the store, asked for file by file: however large it is, no request takes long,
/// and the disk holds one copy at a time. Beside the writer.
namespace cairn {
namespace {

using asked::text_of;
using nlohmann::json;

constexpr size_t kMostBackingUp = 64;
constexpr size_t kMostFaultsTold = 100;  ///< of a file

json describe(const FileCheck& check) {
  json told{{"part", check.part},      {"name", check.name},     {"keyframes", check.keyframes},
            {"points", check.points},  {"labels", check.labels}, {"tags", check.tags},
            {"faults", json::array()}, {"remedy", check.remedy}};
  for (const auto& faults : {check.faults, check.lost_proposals}) {
    for (const std::string& fault : faults)
      if (told["faults"].size() < kMostFaultsTold) told["faults"].push_back(fault);
  }
  return told;
}

/// Of a part that is a map in service, or could be.
std::optional<MapId> map_of(const std::string& part) {
  constexpr std::string_view kMaps = "maps/";
  if (!is_backup_part(part) || !part.starts_with(kMaps)) return std::nullopt;
  const auto bytes = from_hex(part.substr(kMaps.size(), 32));
  return bytes ? std::optional(MapId{*bytes}) : std::nullopt;
}

/// Since the files were listed.
bool has_gone(const std::filesystem::path& folder, const std::string& part) {
  std::error_code ignored;
  return is_backup_part(part) && !std::filesystem::exists(folder / part, ignored);
}

Status check_rights(const std::string& text) {
  const auto rights = read_rights(text);
  return rights ? Status() : tl::unexpected(rights.error());
}

}  // namespace

bool MapService::looks_after_store(const std::string& operator_name, const json& request,
                                   const AdminAnswer& answer) {
  const std::string verb = text_of(request, "verb");
  const std::string part = text_of(request, "part");
  if (verb == "backup") {
    if (backing_up_.size() >= kMostBackingUp) backing_up_.clear();
    backing_up_.insert(operator_name);
    list_parts(text_of(request, "after"), answer);
  } else if (verb == "verify") {
    list_parts(text_of(request, "after"), answer);
  } else if (verb == "backup-part") {
    if (backing_up_.contains(operator_name)) {
      back_up_part(part, answer);
    } else {
      answer(refusal(ErrorCode::kRefused, "no backup of yours is under way; begin it anew"));
    }
  } else if (verb == "verify-part") {
    verify_part(part, answer);
  } else {
    return false;
  }
  return true;
}

void MapService::list_parts(const std::string& after, const AdminAnswer& answer) {
  with_store(answer, [after, answer](const Store& store) -> Task {
    const auto parts = parts_of_store(store.folder());
    if (!parts) return [answer, error = parts.error()] { answer(refusal(error)); };
    ReplyPage page{"parts"};
    for (const std::string& part : *parts) {  // that one may have gone meanwhile
      if ((after.empty() || comes_later(part, after)) && !page.add("parts", part)) break;
    }
    return [answer, told = page.content()] { answer(success(told)); };
  });
}

void MapService::verify_part(const std::string& part, const AdminAnswer& answer) {
  if (store_ == nullptr) return answer(refusal(ErrorCode::kRefused, kNoStore));
  store_->run_examination([this, part, answer](const std::filesystem::path& folder) {
    const FileCheck check = check_part(folder, part, check_rights, FileInUse::kYes);
    const bool is_gone = !check.faults.empty() && has_gone(folder, part);
    post_([answer, told = is_gone ? json{{"gone", true}} : describe(check)] { answer(success(told)); });
  });
}

void MapService::back_up_part(const std::string& part, const AdminAnswer& answer) {
  const auto copy = [this, part, answer](const Store& store) -> Task {
    const auto token = transfers_->begin_export(clock_.now());
    if (!token) return [answer, error = token.error()] { answer(refusal(error)); };
    const std::filesystem::path path = *transfers_->find(*token, clock_.now());
    const Status copied = copy_part(store.folder(), part, path);
    if (!copied) {
      transfers_->end(*token);
      if (has_gone(store.folder(), part)) return [answer] { answer(success({{"gone", true}})); };
      return [answer, error = copied.error()] { answer(refusal(error)); };
    }
    const json told{{"token", *token}, {"bytes", std::filesystem::file_size(path)}};
    return [answer, told] { answer(success(told)); };
  };
  const auto map = map_of(part);
  const MapEntry* entry = map ? maps_.find(*map) : nullptr;
  if (entry == nullptr || entry->runner == nullptr || store_ == nullptr) return with_store(answer, copy);
  // What was handed to the writer is in the file once a task of its own has come to its turn.
  entry->runner->flush([this, answer, copy](const Status& kept) {
    if (!kept) return post_([answer, error = kept.error()] { answer(refusal(error)); });
    store_->run([this, answer, copy](const Store&) { with_store(answer, copy); });
  });
}

}  // namespace cairn
