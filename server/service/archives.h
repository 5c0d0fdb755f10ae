// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "server/service/admin_request.h"
#include "server/service/capacity.h"
#include "server/service/map_administration.h"
#include "server/service/transfers.h"

namespace cairn {

/// Archives of maps, and copies of the store's files, on their way to operators and from them. The work is
/// done beside the store's writer. Used from the service's thread.
class Archives {
 public:
  Archives(const ServiceContext& context, const Capacity& capacity, MapAdministration& maps);
  Archives(const Archives&) = delete;
  Archives& operator=(const Archives&) = delete;

  void export_map(MapId id, const MapEntry& entry, const AdminAnswer& answer);
  void read(const asked::ExportRead& piece, const AdminAnswer& answer);
  void begin_import(const asked::ImportBegin& ask, const AdminAnswer& answer);
  void write(const asked::ImportWrite& piece, std::vector<uint8_t> data, const AdminAnswer& answer);
  void import_map(const asked::Import& ask, const AdminAnswer& answer);
  /// Hands out a file to an operator: `copy` makes it at a path, and the operator can then read it by its
  /// token. To be called beside the store's writer. Error: there is no file.
  [[nodiscard]] Result<told::Copy> hand_out(
      const std::function<Status(const std::filesystem::path& to)>& copy);
  /// Ends transfers, of either direction, that nobody has touched for long (Transfers::kPatience).
  void expire();

 private:
  const ServiceContext& context_;
  const Capacity& capacity_;
  MapAdministration& maps_;
  const std::shared_ptr<Transfers> transfers_;  ///< used beside the store's writer only; null without a store
};

}  // namespace cairn
