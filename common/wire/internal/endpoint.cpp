// SPDX-License-Identifier: Apache-2.0
#include "common/wire/internal/endpoint.h"

#include <algorithm>
#include <array>

#include "common/wire/internal/configuration.h"
#include "common/wire/internal/qos.h"

namespace cairn::wire::internal {
namespace {

constexpr int kBatch = 32;     ///< samples on loan at a time
constexpr int kMaxTake = 256;  ///< per call

Error endpoint_error(std::string_view what, std::string_view topic, dds_return_t code) {
  return {ErrorCode::kInternal,
          std::string(what).append(" ").append(topic).append(": ").append(dds_strretcode(-code))};
}

/// Whether dds_forwardcdr() fails with this before it takes the reference that it is given: the writer is no
/// more, as when our keys have expired. It keeps the reference with all others, of which Cyclone 0.10 has two
/// (DDS_RETCODE_ERROR, DDS_RETCODE_TIMEOUT). An unknown one so costs memory at worst: releasing twice is
/// worse.
bool is_refused_at_once(dds_return_t code) {
  return code == DDS_RETCODE_BAD_PARAMETER || code == DDS_RETCODE_PRECONDITION_NOT_MET ||
         code == DDS_RETCODE_ALREADY_DELETED || code == DDS_RETCODE_ILLEGAL_OPERATION;
}

Error too_large(const char* topic, size_t bytes) {
  const auto megabytes = [](size_t n) { return std::to_string((n + 999'999) / 1'000'000) + " MB"; };
  return {ErrorCode::kRefused, std::string(topic) + " of " + megabytes(bytes) +
                                   ": too large for any peer, which takes " + megabytes(kMaxSampleBytes) +
                                   " at most; smaller images make it smaller"};
}

using EndpointPtr = std::unique_ptr<dds_builtintopic_endpoint_t, decltype(&dds_builtintopic_free_endpoint)>;

/// The middleware's data of the writer that made a publication; null when it has gone.
EndpointPtr matched_publication(dds_entity_t reader, dds_instance_handle_t publication) {
  return {dds_get_matched_publication_data(reader, publication), &dds_builtintopic_free_endpoint};
}

/// The samples taken from a reader, in the middleware's own memory. The destructor gives that back, also
/// where whoever looks at the samples throws.
class Loan {
 public:
  explicit Loan(dds_entity_t reader)
      : reader_(reader), count_(dds_take(reader, samples_.data(), infos_.data(), kBatch, kBatch)) {}
  Loan(const Loan&) = delete;
  Loan& operator=(const Loan&) = delete;
  ~Loan() {
    if (count_ > 0) dds_return_loan(reader_, samples_.data(), count_);
  }
  [[nodiscard]] size_t count() const { return count_ > 0 ? static_cast<size_t>(count_) : 0; }
  [[nodiscard]] const void* sample(size_t i) const { return samples_.at(i); }
  [[nodiscard]] const dds_sample_info_t& info(size_t i) const { return infos_.at(i); }

 private:
  dds_entity_t reader_;
  std::array<void*, kBatch> samples_{};
  std::array<dds_sample_info_t, kBatch> infos_;
  dds_return_t count_;  ///< below 0: an error
};

}  // namespace

Result<std::unique_ptr<WriterEntity>> WriterEntity::create(std::shared_ptr<Context> context,
                                                           const TopicDescription& topic,
                                                           std::string_view partition) {
  const auto topic_entity = context->topic(topic);
  if (!topic_entity) return tl::unexpected(topic_entity.error());
  std::unique_ptr<WriterEntity> made(new WriterEntity(std::move(context), topic.name));
  auto publisher = checked(dds_create_publisher(made->context_->participant(),
                                                partition_qos(std::string(partition)).get(), nullptr),
                           "publisher");
  if (!publisher) return tl::unexpected(publisher.error());
  made->publisher_ = *std::move(publisher);
  auto writer = checked(
      dds_create_writer(made->publisher_.handle(), *topic_entity, writer_qos(topic.qos_class).get(), nullptr),
      std::string("writer of ") + topic.name);
  if (!writer) return tl::unexpected(writer.error());
  made->writer_ = *std::move(writer);
  return made;
}

Status WriterEntity::write(const void* sample, size_t payload_bytes) {
  // The middleware would refuse it as a bad parameter; nobody could tell what to do about it.
  if (payload_bytes > kMaxSampleBytes) return tl::unexpected(too_large(topic_, payload_bytes));
  const dds_return_t code = dds_write(writer_.handle(), sample);
  if (code != DDS_RETCODE_OK) return tl::unexpected(endpoint_error("writing", topic_, code));
  flush();
  context_->bytes_sent += payload_bytes;
  return {};
}

Result<std::shared_ptr<const SerializedSample>> WriterEntity::serialize(const void* sample,
                                                                        size_t payload_bytes) const {
  if (payload_bytes > kMaxSampleBytes) return tl::unexpected(too_large(topic_, payload_bytes));
  const auto type = context_->sertype(topic_, writer_.handle());
  if (!type) return tl::unexpected(type.error());
  ddsi_serdata* data = ddsi_serdata_from_sample(*type, SDK_DATA, sample);
  if (data == nullptr)
    return tl::unexpected(endpoint_error("serializing", topic_, DDS_RETCODE_BAD_PARAMETER));
  // Here and not by each write: what a writer was given may be on its way, in another thread.
  data->statusinfo = 0;
  data->timestamp.v = dds_time();
  return std::make_shared<const SerializedSample>(context_, data, payload_bytes);
}

Status WriterEntity::write(const SerializedSample& sample) {
  if (&sample.context() != context_.get())
    return fail(ErrorCode::kInternal,
                std::string("writing ") + topic_ + ": serialized by another participant");
  const dds_return_t code = dds_forwardcdr(writer_.handle(), ddsi_serdata_ref(sample.data()));
  if (code == DDS_RETCODE_OK) {
    context_->bytes_sent += sample.payload_bytes();
    return {};
  }
  if (is_refused_at_once(code)) ddsi_serdata_unref(sample.data());
  return tl::unexpected(endpoint_error("writing", topic_, code));
}

Status WriterEntity::dispose(const void* sample) {
  const dds_return_t code = dds_dispose(writer_.handle(), sample);
  if (code != DDS_RETCODE_OK) return tl::unexpected(endpoint_error("removing from", topic_, code));
  flush();
  return {};
}

void WriterEntity::flush() {
  if (context_->writes_in_batches()) dds_write_flush(writer_.handle());
}

int WriterEntity::matched() const {
  dds_publication_matched_status_t status{};
  dds_get_publication_matched_status(writer_.handle(), &status);
  return static_cast<int>(status.current_count);
}

Result<std::unique_ptr<ReaderEntity>> ReaderEntity::create(std::shared_ptr<Context> context,
                                                           const TopicDescription& topic,
                                                           std::string_view partition) {
  const auto topic_entity = context->topic(topic);
  if (!topic_entity) return tl::unexpected(topic_entity.error());
  std::unique_ptr<ReaderEntity> made(new ReaderEntity(std::move(context), topic.name));
  auto subscriber = checked(dds_create_subscriber(made->context_->participant(),
                                                  partition_qos(std::string(partition)).get(), nullptr),
                            "subscriber");
  if (!subscriber) return tl::unexpected(subscriber.error());
  made->subscriber_ = *std::move(subscriber);
  const Status adopted = made->adopt(dds_create_reader(made->subscriber_.handle(), *topic_entity,
                                                       reader_qos(topic.qos_class).get(), nullptr),
                                     std::string("reader of ") + topic.name);
  if (!adopted) return tl::unexpected(adopted.error());
  return made;
}

Result<std::unique_ptr<ReaderEntity>> ReaderEntity::create_built_in(std::shared_ptr<Context> context,
                                                                    dds_entity_t topic) {
  std::unique_ptr<ReaderEntity> made(new ReaderEntity(std::move(context), "built-in"));
  const Status adopted =
      made->adopt(dds_create_reader(made->context_->participant(), topic, nullptr, nullptr),
                  "reader of a built-in topic");
  if (!adopted) return tl::unexpected(adopted.error());
  return made;
}

Status ReaderEntity::adopt(dds_entity_t reader, const std::string& what) {
  auto owned = checked(reader, what);
  if (!owned) return tl::unexpected(owned.error());
  reader_ = *std::move(owned);
  condition_ = dds_create_readcondition(reader_.handle(), DDS_ANY_STATE);
  if (condition_ < 0) return tl::unexpected(endpoint_error("condition of", what, condition_));
  return {};
}

void ReaderEntity::take(const std::function<void(const void*, const dds_sample_info_t&)>& visit) {
  for (int taken = 0; taken < kMaxTake;) {
    const Loan loan(reader_.handle());
    if (loan.count() == 0) return;
    for (size_t i = 0; i < loan.count(); ++i) visit(loan.sample(i), loan.info(i));
    taken += static_cast<int>(loan.count());
  }
}

void ReaderEntity::report_unfit(dds_instance_handle_t publication, const std::string& reason) {
  ++invalid_;
  std::string partition = partition_of(publication).value_or("unknown");
  // The peer's own string, on its way to terminals and logs.
  std::replace_if(
      partition.begin(), partition.end(), [](unsigned char c) { return c < 0x20 || c >= 0x7f; }, '?');
  context_->report_unfit(topic_, partition, reason);
}

int ReaderEntity::matched() const {
  dds_subscription_matched_status_t status{};
  dds_get_subscription_matched_status(reader_.handle(), &status);
  return static_cast<int>(status.current_count);
}

int ReaderEntity::alive_writers() const {
  dds_liveliness_changed_status_t status{};
  dds_get_liveliness_changed_status(reader_.handle(), &status);
  return static_cast<int>(status.alive_count);
}

std::optional<std::string> ReaderEntity::partition_of(dds_instance_handle_t publication) const {
  const EndpointPtr endpoint = matched_publication(reader_.handle(), publication);
  if (endpoint == nullptr) return std::nullopt;
  const std::vector<std::string> partitions = partitions_of(endpoint->qos);
  return partitions.size() == 1 ? std::optional(partitions.front()) : std::nullopt;
}

std::optional<dds_guid_t> ReaderEntity::participant_of(dds_instance_handle_t publication) const {
  const EndpointPtr endpoint = matched_publication(reader_.handle(), publication);
  if (endpoint == nullptr) return std::nullopt;
  return endpoint->participant_key;
}

}  // namespace cairn::wire::internal
