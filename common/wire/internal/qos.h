// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/wire/internal/entity.h"
#include "common/wire/limits.h"

/// The QoS classes of idl/README.md, all of them, in one place.
namespace cairn::wire::internal {

enum class QosClass : uint8_t {
  kState,    ///< newest value of every key, also for those who come later
  kClaim,    ///< state of a client, whose key anybody may claim: the reader keeps what each one says
  kStatus,   ///< state, whose writer must say at least once a second that it is not hung (MANUAL_BY_TOPIC)
  kCommand,  ///< every one, in order, once applied; the application bounds how many are in flight (credit)
  kQuery,    ///< newest query or answer, repeated if lost, not for those who come later
  kClaimedQuery,  ///< query of a client, whose key anybody may claim: as kClaim
  kOrder,         ///< every one of the last few of all writers of a key; nothing any more after 100 ms
  kStream,        ///< newest value, lost ones are not repeated; silent writers are seen within 3 s
  kPresence,      ///< stream of a client or a rig, whose key anybody may claim: as kClaim
};

[[nodiscard]] QosPtr writer_qos(QosClass qos_class);
[[nodiscard]] QosPtr reader_qos(QosClass qos_class);
/// The quality of service of publishers and subscribers in a partition.
[[nodiscard]] QosPtr partition_qos(const std::string& partition);
[[nodiscard]] std::vector<std::string> partitions_of(const dds_qos_t* qos);

}  // namespace cairn::wire::internal
