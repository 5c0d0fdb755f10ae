// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <dds/dds.h>
#include <dds/ddsc/dds_statistics.h>

#include <cstdint>
#include <memory>
#include <vector>

#include "common/wire/internal/context.h"
#include "common/wire/participant.h"

namespace cairn::wire {

/// After so many rounds a test about loss that has seen none gives up.
constexpr int kMostRounds = 20;

/// The children of an entity of the middleware.
inline std::vector<dds_entity_t> children_of(dds_entity_t entity) {
  std::vector<dds_entity_t> children(1024);
  const dds_return_t count = dds_get_children(entity, children.data(), children.size());
  children.resize(count > 0 ? static_cast<size_t>(count) : 0);
  return children;
}

/// The bytes that the writers of a participant have sent again because a reader that was there lacked them.
/// For tests that are about loss, which show nothing where this stays 0.
inline uint64_t repeated_bytes(const Participant& participant) {
  uint64_t sum = 0;
  for (const dds_entity_t publisher : children_of(participant.context()->participant())) {
    for (const dds_entity_t writer : children_of(publisher)) {
      const std::unique_ptr<dds_statistics, decltype(&dds_delete_statistics)> all(
          dds_create_statistics(writer), &dds_delete_statistics);
      const dds_stat_keyvalue* repeated =
          all == nullptr ? nullptr : dds_lookup_statistic(all.get(), "rexmit_bytes");
      if (repeated != nullptr) sum += repeated->u.u64;
    }
  }
  return sum;
}

}  // namespace cairn::wire
