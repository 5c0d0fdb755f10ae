// SPDX-License-Identifier: Apache-2.0
#include "server/service/admin_reply.h"

#include <algorithm>
#include <utility>

#include "common/base/utf8.h"
#include "common/io/json_text.h"

namespace cairn {

using nlohmann::json;

namespace {

/// Of the items of a page; the rest is for what frames them.
constexpr size_t kMaxPageBytes = wire::kMaxAdminText - 1000;
constexpr size_t kMaxReasons = 5;  ///< of a damaged file

}  // namespace

json describe(MapId id, const MapEntry& entry) {
  json map{{"id", to_hex(id.bytes)},
           {"name", entry.name},
           {"keyframes", entry.snapshot->keyframe_count()},
           {"points", entry.snapshot->point_count()},
           {"epoch", entry.snapshot->epoch.value},
           {"revision", entry.snapshot->revision.value},
           {"memory_bytes", bytes_of(entry)},
           {"at_rest", is_at_rest(entry)},
           {"plane_aligned", entry.plane_aligned}};
  if (!entry.frozen.empty()) map["frozen"] = entry.frozen;
  return map;
}

json describe(const DeletedMap& map) {
  json told{{"id", to_hex(map.header.id.bytes)},
            {"name", map.header.name},
            {"deleted", map.deleted.nanoseconds},
            {"bytes", map.bytes}};
  if (map.problem)
    told[map.problem->code == ErrorCode::kDamaged ? "damaged" : "unreadable"] = map.problem->message;
  return told;
}

json describe(const OverlapList::Neighbour& neighbour, const std::string& name) {
  return {{"map", name},
          {"id", to_hex(neighbour.map.bytes)},
          {"keyframes", neighbour.keyframes},
          {"its_keyframes", neighbour.its_keyframes},
          {"found", neighbour.found.nanoseconds}};
}

json describe(const std::string& map, const Label& label) {
  const Eigen::Vector3d& place = label.map_from_label.translation();
  return {{"map", map},
          {"id", label.id.value},
          {"kind", label.kind == LabelKind::kModel ? "model" : "text"},
          {"text", label.text},
          {"position", {place.x(), place.y(), place.z()}},
          {"author", label.author},
          {"time", label.time.nanoseconds}};
}

json describe(std::span<const std::pair<CameraParameters, size_t>> cameras) {
  json all = json::array();
  for (const auto& [camera, keyframes] : cameras) {
    all.push_back({{"model", std::string(name_of(camera.model))},
                   {"width", camera.width},
                   {"height", camera.height},
                   {"focal_px", camera.values.at(0)},
                   {"keyframes", keyframes}});
  }
  return all;
}

json describe(const DamagedFile& file, bool served) {
  const size_t told = std::min(file.reasons.size(), kMaxReasons);
  json reasons(
      std::vector<std::string>(file.reasons.begin(), file.reasons.begin() + static_cast<ptrdiff_t>(told)));
  if (told < file.reasons.size())
    reasons.push_back("and " + std::to_string(file.reasons.size() - told) + " more, in the .txt beside it");
  return {{"id", file.map ? to_hex(file.map.bytes) : std::string()},
          {"name", file.name},
          {"file", one_line(file.path.string())},
          {"bytes", file.bytes},
          {"set_aside", file.set_aside.nanoseconds},
          {"served", served},
          {"reasons", std::move(reasons)}};
}

std::string word_of_damage(size_t files, const std::filesystem::path& folder) {
  if (files == 0) return {};
  return std::to_string(files) + (files == 1 ? " damaged file was" : " damaged files were") +
         " set aside in " + folder.string() +
         " (`cairnctl maps` says why); import what is missing from a backup, then move " +
         (files == 1 ? "it" : "them") + " out of there";
}

json describe(const UnloadedMap& map) {
  return {{"id", to_hex(map.map.bytes)},
          {"name", map.name},
          {"file", one_line(map.file.string())},
          {"reason", map.reason}};
}

std::string word_of_unloaded(std::span<const UnloadedMap> maps) {
  if (maps.empty()) return {};
  const std::string how_many = maps.size() == 1 ? "a map is" : std::to_string(maps.size()) + " maps are";
  return how_many + " not served (`cairnctl maps`): " + maps.front().reason +
         "; see to that and start the server again, or move the file away and import an archive";
}

ReplyPage::ReplyPage(std::initializer_list<const char*> lists) : content_{{"more", false}} {
  for (const char* list : lists) content_[list] = json::array();
}

bool ReplyPage::add(const char* list, const json& item) {
  bytes_ += json_ascii(item).size() + 1;
  if (bytes_ > kMaxPageBytes) content_["more"] = true;
  if (content_["more"]) return false;
  content_[list].push_back(item);
  return true;
}

json describe_labels(const std::string& map, std::span<const Label> labels, LabelId after) {
  ReplyPage page{"labels"};
  for (const Label& label : labels) {
    if (label.id > after && !page.add("labels", describe(map, label))) break;
  }
  return page.content();
}

wire::AdminReply refusal(const Error& error) {
  wire::AdminReply reply;
  // Whatever else it is to us, to the operator it is the server's no; a disk that takes nothing is none.
  const bool own_words =
      error.code == ErrorCode::kUsage || error.code == ErrorCode::kDamaged || error.code == ErrorCode::kIo;
  reply.result = static_cast<uint8_t>(exit_code(own_words ? error.code : ErrorCode::kRefused));
  reply.text = cut_text(one_line(error.message), wire::kMaxAdminText);
  return reply;
}

wire::AdminReply refusal(const DeletedMap& map) {
  const std::string remedy = map.problem->code == ErrorCode::kDamaged
                                 ? "`cairnctl maps purge " + to_hex(map.header.id.bytes) +
                                       "` removes it for good, an archive of it can be imported then"
                                 : "nothing is known to be wrong with its file, which stays: see to that";
  return refusal(map.problem->code, map.problem->message + "; " + remedy);
}

wire::AdminReply refusal(ErrorCode code, std::string message) {
  return refusal(Error{code, std::move(message)});
}

wire::AdminReply unknown_map(const std::string& name_or_id) {
  return refusal(ErrorCode::kNotFound, "no map '" + name_or_id + "'; `cairnctl maps` lists them");
}

wire::AdminReply deleted_map(const std::string& name_or_id) {
  return refusal(ErrorCode::kNotFound, "map '" + name_or_id + "' is deleted; `cairnctl map " + name_or_id +
                                           " undelete` puts it back into service");
}

wire::AdminReply success(const json& content) {
  wire::AdminReply reply;
  reply.text = json_ascii(content);
  return reply;
}

}  // namespace cairn
