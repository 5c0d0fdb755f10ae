// SPDX-License-Identifier: Apache-2.0
#include "common/wire/internal/qos.h"

namespace cairn::wire::internal {
namespace {

constexpr dds_duration_t kServerLiveliness = DDS_SECS(1);
constexpr dds_duration_t kTrackerLiveliness = DDS_SECS(3);
constexpr int32_t kOrderDepth = 16;
constexpr dds_duration_t kOrderLife = DDS_MSECS(100);

QosPtr common_qos(QosClass qos_class) {
  QosPtr qos(dds_create_qos());
  switch (qos_class) {
    case QosClass::kStatus:
      dds_qset_liveliness(qos.get(), DDS_LIVELINESS_MANUAL_BY_TOPIC, kServerLiveliness);
      [[fallthrough]];
    case QosClass::kClaim:
    case QosClass::kState:
      dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, 0);
      dds_qset_durability(qos.get(), DDS_DURABILITY_TRANSIENT_LOCAL);
      dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 1);
      dds_qset_durability_service(qos.get(), 0, DDS_HISTORY_KEEP_LAST, 1, DDS_LENGTH_UNLIMITED,
                                  DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
      break;
    case QosClass::kCommand:
      dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, 0);
      dds_qset_durability(qos.get(), DDS_DURABILITY_VOLATILE);
      dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, int32_t{kCommandDepth});
      break;
    case QosClass::kClaimedQuery:
    case QosClass::kQuery:
      dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, 0);
      dds_qset_durability(qos.get(), DDS_DURABILITY_VOLATILE);
      dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 1);
      break;
    case QosClass::kOrder:
      dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, 0);
      dds_qset_durability(qos.get(), DDS_DURABILITY_VOLATILE);
      dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, kOrderDepth);
      break;
    case QosClass::kPresence:
    case QosClass::kStream:
      dds_qset_reliability(qos.get(), DDS_RELIABILITY_BEST_EFFORT, 0);
      dds_qset_durability(qos.get(), DDS_DURABILITY_VOLATILE);
      dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 1);
      dds_qset_liveliness(qos.get(), DDS_LIVELINESS_AUTOMATIC, kTrackerLiveliness);
      break;
  }
  return qos;
}

}  // namespace

QosPtr writer_qos(QosClass qos_class) {
  QosPtr qos = common_qos(qos_class);
  // A removal is said, never implied: a server that shuts down does not delete its clients' maps.
  dds_qset_writer_data_lifecycle(qos.get(), false);
  if (qos_class == QosClass::kOrder) dds_qset_lifespan(qos.get(), kOrderLife);
  return qos;
}

QosPtr reader_qos(QosClass qos_class) {
  QosPtr qos = common_qos(qos_class);
  // Never resource limits: a full reader stops every reader of the process (Cyclone DDS 0.10.2).
  switch (qos_class) {
    case QosClass::kCommand:
    case QosClass::kClaim:
    case QosClass::kClaimedQuery:
    case QosClass::kPresence:
      // Of one key the middleware keeps the newest of whoever wrote it: a client that claims another's would
      // push out what that one has said, before anybody looks whose it is.
      dds_qset_history(qos.get(), DDS_HISTORY_KEEP_ALL, 0);
      break;
    default:
      break;
  }
  return qos;
}

QosPtr partition_qos(const std::string& partition) {
  QosPtr qos(dds_create_qos());
  dds_qset_partition1(qos.get(), partition.c_str());
  return qos;
}

std::vector<std::string> partitions_of(const dds_qos_t* qos) {
  uint32_t count = 0;
  char** names = nullptr;
  if (!dds_qget_partition(qos, &count, &names)) return {};
  const auto free_names = [count](char** all) {
    for (uint32_t i = 0; i < count; ++i) dds_free(all[i]);
    dds_free(static_cast<void*>(all));
  };
  const std::unique_ptr<char*, decltype(free_names)> owned(names, free_names);
  return {names, names + count};
}

}  // namespace cairn::wire::internal
