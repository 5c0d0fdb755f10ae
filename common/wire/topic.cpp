// SPDX-License-Identifier: Apache-2.0
#include "common/wire/topic.h"

#include <algorithm>

#include "common/wire/discovered.h"
#include "common/wire/internal/convert.h"
#include "common/wire/internal/endpoint.h"
#include "common/wire/serialized_writer.h"

namespace cairn::wire {
namespace {

using internal::QosClass;
using internal::TopicDescription;

/// The table of idl/README.md.
template <typename Message>
TopicDescription topic_of();
#define CAIRN_WIRE_TOPIC(Message, Name, Class)             \
  template <>                                              \
  TopicDescription topic_of<Message>() {                   \
    return {#Name, &cairn_##Name##_desc, QosClass::Class}; \
  }
CAIRN_WIRE_TOPIC(CameraMessage, Camera, kClaim)
CAIRN_WIRE_TOPIC(MapSeed, MapSeed, kCommand)
CAIRN_WIRE_TOPIC(KeyframeOffer, KeyframeOffer, kCommand)
CAIRN_WIRE_TOPIC(TrackerStateMessage, TrackerState, kPresence)
CAIRN_WIRE_TOPIC(ServerStatus, ServerStatus, kStatus)
CAIRN_WIRE_TOPIC(MapInfo, MapInfo, kState)
CAIRN_WIRE_TOPIC(PointPatches, PointPatches, kState)
CAIRN_WIRE_TOPIC(PointPositions, PointPositions, kState)
CAIRN_WIRE_TOPIC(KeyframePoses, KeyframePoses, kState)
CAIRN_WIRE_TOPIC(MapCommit, MapCommit, kState)
CAIRN_WIRE_TOPIC(SeedVerdict, SeedVerdict, kState)
CAIRN_WIRE_TOPIC(OfferVerdict, OfferVerdict, kState)
CAIRN_WIRE_TOPIC(RelocQuery, RelocQuery, kClaimedQuery)
CAIRN_WIRE_TOPIC(RelocAnswer, RelocAnswer, kQuery)
CAIRN_WIRE_TOPIC(CameraEstimate, CameraEstimate, kState)
CAIRN_WIRE_TOPIC(ClientRequest, ClientRequest, kCommand)
CAIRN_WIRE_TOPIC(ClientReply, ClientReply, kState)
CAIRN_WIRE_TOPIC(LabelMessage, Label, kState)
CAIRN_WIRE_TOPIC(AdminRequest, AdminRequest, kCommand)
CAIRN_WIRE_TOPIC(AdminReply, AdminReply, kState)
CAIRN_WIRE_TOPIC(RigCommand, RigCommand, kOrder)
CAIRN_WIRE_TOPIC(RigState, RigState, kPresence)
CAIRN_WIRE_TOPIC(WearerCamera, WearerCamera, kState)
CAIRN_WIRE_TOPIC(PictureRequest, PictureRequest, kStream)
CAIRN_WIRE_TOPIC(CameraPicture, CameraPicture, kStream)
#undef CAIRN_WIRE_TOPIC

}  // namespace

template <typename Message>
std::string_view topic_name() {
  return topic_of<Message>().name;
}

// ---- Writer

template <typename Message>
Result<Writer<Message>> Writer<Message>::create(const Participant& participant, std::string_view partition) {
  auto entity = internal::WriterEntity::create(participant.context(), topic_of<Message>(), partition);
  if (!entity) return tl::unexpected(entity.error());
  return Writer(*std::move(entity));
}

template <typename Message>
Writer<Message>::Writer(std::unique_ptr<internal::WriterEntity> entity) : entity_(std::move(entity)) {}
template <typename Message>
Writer<Message>::Writer(Writer&&) noexcept = default;
template <typename Message>
Writer<Message>& Writer<Message>::operator=(Writer&&) noexcept = default;
template <typename Message>
Writer<Message>::~Writer() = default;

template <typename Message>
Status Writer<Message>::write(const Message& message) {
  internal::Scratch scratch;
  const auto sample = internal::encode(message, &scratch);
  return entity_->write(&sample, internal::payload_bytes<Message>(sample));
}

template <typename Message>
Status Writer<Message>::dispose(const Message& key) {
  internal::Scratch scratch;
  const auto sample = internal::encode(key, &scratch);
  return entity_->dispose(&sample);
}

template <typename Message>
int Writer<Message>::matched() const {
  return entity_->matched();
}

// ---- SerializedWriter

template <typename Message>
Result<SerializedWriter<Message>> SerializedWriter<Message>::create(const Participant& participant,
                                                                    std::string_view partition) {
  auto entity = internal::WriterEntity::create(participant.context(), topic_of<Message>(), partition);
  if (!entity) return tl::unexpected(entity.error());
  return SerializedWriter(*std::move(entity));
}

template <typename Message>
SerializedWriter<Message>::SerializedWriter(std::unique_ptr<internal::WriterEntity> entity)
    : entity_(std::move(entity)) {}
template <typename Message>
SerializedWriter<Message>::SerializedWriter(SerializedWriter&&) noexcept = default;
template <typename Message>
SerializedWriter<Message>& SerializedWriter<Message>::operator=(SerializedWriter&&) noexcept = default;
template <typename Message>
SerializedWriter<Message>::~SerializedWriter() = default;

template <typename Message>
Result<Serialized<Message>> SerializedWriter<Message>::serialize(const Message& message) const {
  internal::Scratch scratch;
  const auto sample = internal::encode(message, &scratch);
  const size_t bytes = internal::payload_bytes<Message>(sample);
  auto serialized = entity_->serialize(&sample, bytes);
  if (!serialized) return tl::unexpected(serialized.error());
  return Serialized<Message>{*std::move(serialized), bytes};
}

template <typename Message>
Status SerializedWriter<Message>::write(const Serialized<Message>& message) {
  return entity_->write(*message.sample);
}

template <typename Message>
void SerializedWriter<Message>::flush() {
  entity_->flush();
}

template <typename Message>
int SerializedWriter<Message>::matched() const {
  return entity_->matched();
}

// ---- Reader

ReaderBase::ReaderBase(std::unique_ptr<internal::ReaderEntity> entity) : entity_(std::move(entity)) {}
ReaderBase::ReaderBase(ReaderBase&&) noexcept = default;
ReaderBase& ReaderBase::operator=(ReaderBase&&) noexcept = default;
ReaderBase::~ReaderBase() = default;

int ReaderBase::matched() const {
  return entity_->matched();
}
int ReaderBase::alive_writers() const {
  return entity_->alive_writers();
}
uint64_t ReaderBase::invalid() const {
  return entity_->invalid();
}

std::optional<std::string> ReaderBase::partition_of(PublicationHandle publication) const {
  return entity_->partition_of(publication.value);
}

std::optional<PeerId> ReaderBase::peer_of(PublicationHandle publication) const {
  const auto key = entity_->participant_of(publication.value);
  if (!key) return std::nullopt;
  PeerId peer;
  std::copy(std::begin(key->v), std::end(key->v), peer.bytes.begin());
  return peer;
}

template <typename Message>
Result<Reader<Message>> Reader<Message>::create(const Participant& participant, std::string_view partition) {
  auto entity = internal::ReaderEntity::create(participant.context(), topic_of<Message>(), partition);
  if (!entity) return tl::unexpected(entity.error());
  return Reader(*std::move(entity));
}

template <typename Message>
std::vector<Sample<Message>> Reader<Message>::take() {
  std::vector<Sample<Message>> samples;
  entity_->take([&](const void* data, const dds_sample_info_t& info) {
    const auto& sample = *static_cast<const internal::DdsType<Message>*>(data);
    const PublicationHandle publication{info.publication_handle};
    if (info.valid_data) {
      entity_->count_received(internal::payload_bytes<Message>(sample));
      if (Result<Message> message = internal::decode<Message>(sample)) {
        samples.push_back({*std::move(message), {}, {}, publication});
      } else {
        entity_->report_unfit(info.publication_handle, message.error().message);
      }
    }
    // The end of an instance comes as a sample without data or, when its last value has not been taken yet,
    // as the state of that value.
    if (info.instance_state != DDS_ALIVE_INSTANCE_STATE && info.sample_rank == 0) {
      const Gone gone =
          info.instance_state == DDS_NOT_ALIVE_DISPOSED_INSTANCE_STATE ? Gone::kDisposed : Gone::kNoWriters;
      samples.push_back({std::nullopt, gone, internal::decode_key<Message>(sample), publication});
    }
  });
  return samples;
}

#define CAIRN_WIRE_INSTANTIATE(Message, Dds)       \
  template std::string_view topic_name<Message>(); \
  template class Writer<Message>;                  \
  template class Reader<Message>;
CAIRN_WIRE_MESSAGES(CAIRN_WIRE_INSTANTIATE)
#undef CAIRN_WIRE_INSTANTIATE

template class SerializedWriter<PointPatches>;
template class SerializedWriter<PointPositions>;
template class SerializedWriter<KeyframePoses>;

}  // namespace cairn::wire
