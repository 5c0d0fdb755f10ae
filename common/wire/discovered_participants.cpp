// SPDX-License-Identifier: Apache-2.0
#include "common/wire/discovered_participants.h"

#include <string_view>
#include <utility>

#include "common/base/utf8.h"
#include "common/wire/internal/endpoint.h"

namespace cairn::wire {
namespace {

constexpr size_t kMostBytes = 60;  ///< of each thing that it says of itself

std::string property_of(const dds_qos_t* qos, const char* name) {
  char* value = nullptr;
  if (!dds_qget_prop(qos, name, &value) || value == nullptr) return {};
  std::string text(cut_text(one_line(value), kMostBytes));
  dds_free(value);
  return text;
}

std::string words_of(const dds_qos_t* qos) {
  std::string words;
  for (const auto& [name, what] : {std::pair("__ProcessName", "process "), std::pair("__Hostname", "host "),
                                   std::pair("__NetworkAddresses", "address ")}) {
    const std::string value = property_of(qos, name);
    if (!value.empty()) words += (words.empty() ? "" : ", ") + (what + value);
  }
  return words.empty() ? "it says nothing of itself" : words;
}

}  // namespace

Result<DiscoveredParticipants> DiscoveredParticipants::create(const Participant& participant) {
  auto entity =
      internal::ReaderEntity::create_built_in(participant.context(), DDS_BUILTIN_TOPIC_DCPSPARTICIPANT);
  if (!entity) return tl::unexpected(entity.error());
  return DiscoveredParticipants(*std::move(entity));
}

std::vector<DiscoveredParticipant> DiscoveredParticipants::take() {
  std::vector<DiscoveredParticipant> changes;
  dds_instance_handle_t own = 0;
  dds_get_instance_handle(entity_->context().participant(), &own);
  entity_->take([&](const void* sample, const dds_sample_info_t& info) {
    const auto* participant = static_cast<const dds_builtintopic_participant_t*>(sample);
    const uint64_t handle = info.instance_handle;
    if (info.valid_data && handle != own && !known_.contains(handle)) {
      DiscoveredParticipant peer{handle, words_of(participant->qos), false};
      changes.push_back(peer);
      known_.emplace(handle, std::move(peer));
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
