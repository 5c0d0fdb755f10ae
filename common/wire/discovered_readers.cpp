// SPDX-License-Identifier: Apache-2.0
#include "common/wire/discovered_readers.h"

#include <cstring>

#include "common/wire/internal/endpoint.h"

namespace cairn::wire {
namespace {

std::vector<std::string> partitions_of(const dds_qos_t* qos) {
  uint32_t count = 0;
  char** names = nullptr;
  if (!dds_qget_partition(qos, &count, &names)) return {};
  std::vector<std::string> partitions(names, names + count);
  for (uint32_t i = 0; i < count; ++i) dds_free(names[i]);
  dds_free(static_cast<void*>(names));
  return partitions;
}

}  // namespace

Result<DiscoveredReaders> DiscoveredReaders::create(const Participant& participant) {
  auto entity =
      internal::ReaderEntity::create_built_in(participant.context(), DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION);
  if (!entity) return tl::unexpected(entity.error());
  return DiscoveredReaders(*std::move(entity));
}

std::vector<DiscoveredReader> DiscoveredReaders::take() {
  std::vector<DiscoveredReader> changes;
  dds_instance_handle_t own = 0;
  dds_get_instance_handle(entity_->context().participant(), &own);
  entity_->take([&](const void* sample, const dds_sample_info_t& info) {
    const auto* endpoint = static_cast<const dds_builtintopic_endpoint_t*>(sample);
    const uint64_t handle = info.instance_handle;
    if (info.valid_data && endpoint->participant_instance_handle != own && !known_.contains(handle)) {
      DiscoveredReader reader{handle, endpoint->topic_name, partitions_of(endpoint->qos), false,
                              endpoint->participant_instance_handle};
      changes.push_back(reader);
      known_.emplace(handle, std::move(reader));
    }
    if (info.instance_state == DDS_ALIVE_INSTANCE_STATE) return;
    if (auto known = known_.extract(handle)) {
      known.mapped().gone = true;
      changes.push_back(std::move(known.mapped()));
    }
  });
  return changes;
}

}  // namespace cairn::wire
