// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/service/admin_request.h"
#include "server/service/labels.h"
#include "server/service/operator_answer.h"

namespace cairn {

/// What operators ask about labels. Used from the service's thread.
class LabelAdministration {
 public:
  explicit LabelAdministration(Labels& labels) : labels_(labels) {}
  LabelAdministration(const LabelAdministration&) = delete;
  LabelAdministration& operator=(const LabelAdministration&) = delete;

  void take(const Principal& who, MapId id, const MapEntry& entry, const asked::Labels& ask,
            const AdminAnswer& answer) const;
  void take(const Principal& who, MapId id, const MapEntry& entry, const asked::RenameLabel& ask,
            const AdminAnswer& answer);
  void take(const Principal& who, MapId id, const MapEntry& entry, const asked::RemoveLabel& ask,
            const AdminAnswer& answer);

 private:
  /// `wish`: action, map, label, text.
  void edit(const Principal& who, const MapEntry& entry, const wire::ClientRequest& wish,
            const AdminAnswer& answer);

  Labels& labels_;
};

}  // namespace cairn
