// SPDX-License-Identifier: Apache-2.0
#include "common/wire/discovered.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "common/base/utf8.h"
#include "common/wire/internal/endpoint.h"
#include "common/wire/internal/qos.h"

namespace cairn::wire {
namespace {

constexpr size_t kMostBytes = 60;  ///< of each thing that a participant says of itself

std::string property_of(const dds_qos_t* qos, const char* name) {
  char* value = nullptr;
  if (!dds_qget_prop(qos, name, &value) || value == nullptr) return {};
  const internal::DdsPtr<char> owned(value);
  return std::string(cut_text(one_line(value), kMostBytes));
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

/// The built-in topic that tells of a kind of peers, and how its samples are read.
template <typename Peer>
struct BuiltIn;

template <>
struct BuiltIn<DiscoveredReader> {
  using Sample = dds_builtintopic_endpoint_t;
  static constexpr dds_entity_t kTopic = DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION;
  static uint64_t participant_of(const Sample& reader, uint64_t /*handle*/) {
    return reader.participant_instance_handle;
  }
  static DiscoveredReader read(const Sample& reader, uint64_t handle) {
    PeerId process;
    std::copy(std::begin(reader.participant_key.v), std::end(reader.participant_key.v),
              process.bytes.begin());
    return {handle,
            reader.topic_name,
            internal::partitions_of(reader.qos),
            false,
            reader.participant_instance_handle,
            process};
  }
};

template <>
struct BuiltIn<DiscoveredParticipant> {
  using Sample = dds_builtintopic_participant_t;
  static constexpr dds_entity_t kTopic = DDS_BUILTIN_TOPIC_DCPSPARTICIPANT;
  static uint64_t participant_of(const Sample& /*participant*/, uint64_t handle) { return handle; }
  static DiscoveredParticipant read(const Sample& participant, uint64_t handle) {
    return {handle, words_of(participant.qos), false};
  }
};

}  // namespace

template <typename Peer>
Result<Discovered<Peer>> Discovered<Peer>::create(const Participant& participant) {
  auto entity = internal::ReaderEntity::create_built_in(participant.context(), BuiltIn<Peer>::kTopic);
  if (!entity) return tl::unexpected(entity.error());
  return Discovered(*std::move(entity));
}

template <typename Peer>
std::vector<Peer> Discovered<Peer>::take() {
  std::vector<Peer> changes;
  dds_instance_handle_t own = 0;
  dds_get_instance_handle(entity_->context().participant(), &own);
  entity_->take([&](const void* data, const dds_sample_info_t& info) {
    const auto& sample = *static_cast<const typename BuiltIn<Peer>::Sample*>(data);
    const uint64_t handle = info.instance_handle;
    if (info.valid_data && BuiltIn<Peer>::participant_of(sample, handle) != own && !known_.contains(handle)) {
      Peer peer = BuiltIn<Peer>::read(sample, handle);
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

template class Discovered<DiscoveredReader>;
template class Discovered<DiscoveredParticipant>;

}  // namespace cairn::wire
