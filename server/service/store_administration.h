// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <set>
#include <string>

#include "server/service/archives.h"

namespace cairn {

/// Backup and verification of the store, asked for file by file: however large it is, no request takes long,
/// and the disk holds one copy at a time. Beside the writer. Used from the service's thread.
class StoreAdministration {
 public:
  StoreAdministration(const ServiceContext& context, const MapArray& maps, Archives& archives)
      : context_(context), maps_(maps), archives_(archives) {}
  StoreAdministration(const StoreAdministration&) = delete;
  StoreAdministration& operator=(const StoreAdministration&) = delete;

  void take(const std::string& operator_name, const asked::Backup& ask, const AdminAnswer& answer);
  /// Error kRefused: the operator has not begun a backup.
  void take(const std::string& operator_name, const asked::BackupPart& ask, const AdminAnswer& answer);
  void take(const asked::Verify& ask, const AdminAnswer& answer);
  void take(const asked::VerifyPart& ask, const AdminAnswer& answer);

 private:
  void list_parts(const std::string& after, const AdminAnswer& answer);

  const ServiceContext& context_;
  const MapArray& maps_;
  Archives& archives_;
  std::set<std::string> backing_up_;  ///< operators who have begun a backup, which is on record
};

}  // namespace cairn
