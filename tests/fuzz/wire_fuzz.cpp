// SPDX-License-Identifier: Apache-2.0
//
// Samples as they come from the network: the first byte chooses the topic, the rest is what a peer
// serialized, with its header. The middleware checks and reads it as it does for a reader, and our decoder
// judges the rest.
#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>
#include <dds/ddsi/ddsi_sertype.h>

#include <array>
#include <functional>

#include "common/wire/internal/convert.h"
#include "common/wire/test_messages.h"
#include "tests/fuzz/fuzz_target.h"

namespace cairn::fuzz {
namespace {

using wire::internal::DdsType;
using wire::testing::RandomMessages;

constexpr unsigned kSeed = 1;
constexpr int kSeedsPerTopic = 3;
constexpr uint32_t kHeaderBytes = 4;  // of CDR: encoding and options
/// Behind each input. Cyclone 0.10.2 checks arrays and sequences of eight-byte numbers as if they were of
/// four bytes, and reads up to that much beyond the end (README.md): it would be found again and again.
constexpr size_t kSlackBytes = 4096;

/// The participant of this process; it talks to nobody.
class Middleware {
 public:
  static Middleware& instance() {
    static Middleware middleware;
    return middleware;
  }
  [[nodiscard]] dds_entity_t participant() const { return participant_; }

 private:
  Middleware() {
    const char* alone =
        "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name=\"lo\"/></Interfaces>"
        "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>none</ParticipantIndex>"
        "</Discovery></Domain></CycloneDDS>";
    domain_ = dds_create_domain(230, alone);
    participant_ = dds_create_participant(230, nullptr, nullptr);
    demand(participant_ > 0, "the middleware has a participant");
  }
  dds_entity_t domain_ = 0;
  dds_entity_t participant_ = 0;
};

/// Writes `sample` and takes it as a reader would have it, serialized.
ddsi_serdata* serialized(dds_entity_t writer, dds_entity_t reader, const void* sample) {
  demand(dds_write(writer, sample) == DDS_RETCODE_OK, "a sound sample can be written");
  ddsi_serdata* data = nullptr;
  dds_sample_info_t info;
  demand(dds_takecdr(reader, &data, 1, &info, DDS_ANY_STATE) == 1, "what is written arrives");
  return data;
}

template <typename Message>
class Topic {
 public:
  Topic(const char* name, const dds_topic_descriptor_t* type) {
    const dds_entity_t participant = Middleware::instance().participant();
    dds_qos_t* qos = dds_create_qos();
    dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
    const dds_entity_t topic = dds_create_topic(participant, type, name, nullptr, nullptr);
    reader_ = dds_create_reader(participant, topic, qos, nullptr);
    writer_ = dds_create_writer(participant, topic, qos, nullptr);
    dds_delete_qos(qos);
    demand(reader_ > 0 && writer_ > 0, "a topic can be read and written");
    first_ = sample_of(random_.make<Message>());
  }

  void decode(Bytes bytes) const {
    if (bytes.size() < kHeaderBytes) return;
    static std::array<uint8_t, kSlackBytes> slack{};
    const std::array<ddsrt_iovec_t, 2> parts{
        {{const_cast<uint8_t*>(bytes.data()), bytes.size()}, {slack.data(), slack.size()}}};
    ddsi_serdata* data = ddsi_serdata_from_ser_iov(first_->type, SDK_DATA, parts.size(), parts.data(),
                                                   bytes.size() + slack.size());
    if (data == nullptr) return;  // refused by the middleware
    DdsType<Message> sample{};
    if (ddsi_serdata_to_sample(data, &sample, nullptr, nullptr)) check(sample);
    ddsi_sertype_free_sample(first_->type, &sample, DDS_FREE_CONTENTS);
    ddsi_serdata_unref(data);
  }

  [[nodiscard]] std::vector<uint8_t> seed() {
    ddsi_serdata* data = sample_of(random_.make<Message>());
    std::vector<uint8_t> bytes(ddsi_serdata_size(data));
    ddsi_serdata_to_ser(data, 0, bytes.size(), bytes.data());
    ddsi_serdata_unref(data);
    return bytes;
  }

 private:
  ddsi_serdata* sample_of(const Message& message) {
    wire::internal::Scratch scratch;
    const auto sample = wire::internal::encode(message, &scratch);
    return serialized(writer_, reader_, &sample);
  }
  /// What is let through is what we could have written.
  static void check(const DdsType<Message>& sample) {
    const auto message = wire::internal::decode<Message>(sample);
    if (!message) {
      demand(!message.error().message.empty(), "a refusal has a reason");
      return;
    }
    wire::internal::Scratch scratch;
    const auto encoded = wire::internal::encode(*message, &scratch);
    demand(wire::internal::decode<Message>(encoded).has_value(), "what is let through can be sent on");
  }

  RandomMessages random_{kSeed};
  dds_entity_t reader_ = 0;
  dds_entity_t writer_ = 0;
  ddsi_serdata* first_ = nullptr;  ///< knows the type; never given back
};

struct AnyTopic {
  std::function<void(std::span<const uint8_t>)> decode;
  std::function<std::vector<uint8_t>()> seed;
};

template <typename Message>
AnyTopic make_topic(const char* name, const dds_topic_descriptor_t* type) {
  const auto topic = std::make_shared<Topic<Message>>(name, type);
  return {[topic](auto bytes) { topic->decode(bytes); }, [topic] { return topic->seed(); }};
}

const std::vector<AnyTopic>& topics() {
  using namespace wire;
  static const std::vector<AnyTopic> all{
#define CAIRN_FUZZ_TOPIC(Message, Dds) make_topic<Message>(#Dds, &Dds##_desc),
      CAIRN_WIRE_MESSAGES(CAIRN_FUZZ_TOPIC)
#undef CAIRN_FUZZ_TOPIC
  };
  return all;
}

}  // namespace

void decode(Bytes bytes) {
  if (bytes.empty()) return;
  topics()[bytes[0] % topics().size()].decode(bytes.subspan(1));
}

std::vector<Input> seeds() {
  std::vector<Input> all;
  for (size_t i = 0; i < topics().size(); ++i) {
    for (int k = 0; k < kSeedsPerTopic; ++k) {
      all.push_back(input_of(i, topics()[i].seed()));
    }
  }
  return all;
}

}  // namespace cairn::fuzz
