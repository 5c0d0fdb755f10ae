// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <utility>

#include "common/wire/messages.h"
#include "server/service/map_array.h"
#include "server/service/overlap_list.h"
#include "server/store/store.h"

/// What operators are answered (idl/README.md, AdminReply). Pure.
namespace cairn {

/// To be called once, on the service's thread.
using AdminAnswer = std::function<void(wire::AdminReply reply)>;

/// Of a map that is served, that is, has a snapshot.
[[nodiscard]] nlohmann::json describe(MapId id, const MapEntry& entry);
/// One that cannot be used is `damaged`, or `unreadable` when that may pass.
[[nodiscard]] nlohmann::json describe(const DeletedMap& map);
/// `name`: of the neighbour.
[[nodiscard]] nlohmann::json describe(const OverlapList::Neighbour& neighbour, const std::string& name);
/// `map`: the name of the label's.
[[nodiscard]] nlohmann::json describe(const std::string& map, const Label& label);
/// Cameras, and how many keyframes each took.
[[nodiscard]] nlohmann::json describe(std::span<const std::pair<CameraParameters, size_t>> cameras);
/// `served`: what could be saved of it is. With the first few reasons.
[[nodiscard]] nlohmann::json describe(const DamagedFile& file, bool served);
/// For the server's health: what lies in a folder of damaged files, and the remedy. Empty when nothing does.
[[nodiscard]] std::string word_of_damage(size_t files, const std::filesystem::path& folder);
[[nodiscard]] nlohmann::json describe(const UnloadedMap& map);
/// For the server's health: the first of them, and the remedy. Empty when there is none.
[[nodiscard]] std::string word_of_unloaded(std::span<const UnloadedMap> maps);
/// A part of some lists that may be long: as much of them as one reply takes. `more`: there is more.
class ReplyPage {
 public:
  explicit ReplyPage(std::initializer_list<const char*> lists);
  /// False: it is full, and so are all lists from then on.
  bool add(const char* list, const nlohmann::json& item);
  [[nodiscard]] const nlohmann::json& content() const { return content_; }

 private:
  nlohmann::json content_;
  size_t bytes_ = 0;
};

/// A page of those beyond the id `after`. `labels`: ascending by id.
[[nodiscard]] nlohmann::json describe_labels(const std::string& map, std::span<const Label> labels,
                                             LabelId after);

/// To who asks for what is only done with a store.
inline constexpr const char* kNoStore = "this server keeps nothing: start it with --store DIR";

[[nodiscard]] wire::AdminReply refusal(const Error& error);
/// Of what is asked of a map that cannot be used, with the remedy.
[[nodiscard]] wire::AdminReply refusal(const DeletedMap& map);
[[nodiscard]] wire::AdminReply refusal(ErrorCode code, std::string message);
[[nodiscard]] wire::AdminReply unknown_map(const std::string& name_or_id);
/// Of one that must be undeleted first.
[[nodiscard]] wire::AdminReply deleted_map(const std::string& name_or_id);
[[nodiscard]] wire::AdminReply success(const nlohmann::json& content);

}  // namespace cairn
