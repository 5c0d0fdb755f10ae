// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <initializer_list>
#include <nlohmann/json.hpp>

#include "server/service/operator_answer.h"
#include "server/store/check_report.h"

/// The answers to operators as JSON (idl/README.md, AdminReply). Pure.
namespace cairn {

/// A part of some lists that may be long: as much of them as one reply takes. `more`: there is more.
class ReplyPage {
 public:
  explicit ReplyPage(std::initializer_list<const char*> lists);
  /// Adds an item to a list. False: the page is full, and so are all its lists from then on.
  bool add(const char* list, const nlohmann::json& item);
  /// Adds as many items as fit.
  template <typename Item>
  void add_all(const char* list, const std::vector<Item>& items);
  [[nodiscard]] const nlohmann::json& content() const { return content_; }

 private:
  nlohmann::json content_;
  size_t bytes_ = 0;
};

/// The answer as JSON; the data of a piece are not in it.
[[nodiscard]] nlohmann::json content_of(const told::Answer& answer);

// The server and its maps.
[[nodiscard]] nlohmann::json describe(const told::RigSeen& rig);
[[nodiscard]] nlohmann::json describe(const told::ClientSeen& client);
[[nodiscard]] nlohmann::json describe(const told::OverlapSeen& overlap);
/// A camera, and how many keyframes it took.
[[nodiscard]] nlohmann::json describe(const std::pair<CameraParameters, size_t>& taken);
[[nodiscard]] nlohmann::json describe(const told::Server& server);
[[nodiscard]] nlohmann::json describe(const told::Rigs& rigs);
[[nodiscard]] nlohmann::json describe(const told::Clients& clients);
[[nodiscard]] nlohmann::json describe(const told::Map& map);
[[nodiscard]] nlohmann::json describe(const told::BusyMap& map);
[[nodiscard]] nlohmann::json describe(const told::WholeMap& map);
[[nodiscard]] nlohmann::json describe(const told::Maps& maps);
/// Describes a deleted map. One that cannot be used is `damaged`, or `unreadable` when that may pass.
[[nodiscard]] nlohmann::json describe(const DeletedMap& map);
/// Describes a damaged file with the first few reasons.
[[nodiscard]] nlohmann::json describe(const told::DamagedSeen& damaged);
[[nodiscard]] nlohmann::json describe(const UnloadedMap& map);

// Archives, files of the store, versions, labels, proposals.
[[nodiscard]] nlohmann::json describe(const told::Copy& copy);
[[nodiscard]] nlohmann::json describe(const told::Archive& archive);
[[nodiscard]] nlohmann::json describe(const told::Parts& parts);
[[nodiscard]] nlohmann::json describe(const MapTag& tag);
[[nodiscard]] nlohmann::json describe(const told::Tags& tags);
[[nodiscard]] nlohmann::json describe(const told::Contributor& contributor);
[[nodiscard]] nlohmann::json describe(const told::Contributors& contributors);
[[nodiscard]] nlohmann::json describe(const told::LabelSeen& label);
[[nodiscard]] nlohmann::json describe(const told::Labels& labels);
[[nodiscard]] nlohmann::json describe(const told::ProposalSeen& proposal);
[[nodiscard]] nlohmann::json describe(const told::Proposals& proposals);
/// x, y and whether it was found.
[[nodiscard]] nlohmann::json describe(const ExpectedPoint& point);
[[nodiscard]] nlohmann::json describe(const told::WholeProposal& proposal);
[[nodiscard]] nlohmann::json describe(const told::AcceptedProposal& proposal);

// Rights, and what was done.
[[nodiscard]] nlohmann::json describe(const told::Rights& rights);
[[nodiscard]] nlohmann::json describe(const told::ExplainedRights& rights);
[[nodiscard]] nlohmann::json describe(const AuditEntry& entry);
[[nodiscard]] nlohmann::json describe(const told::Audit& audit);

template <typename Item>
[[nodiscard]] nlohmann::json list_of(const std::vector<Item>& items) {
  nlohmann::json list = nlohmann::json::array();
  for (const Item& item : items) list.push_back(describe(item));
  return list;
}

template <typename Item>
void ReplyPage::add_all(const char* list, const std::vector<Item>& items) {
  for (const Item& item : items) {
    if (!add(list, describe(item))) return;
  }
}

}  // namespace cairn
