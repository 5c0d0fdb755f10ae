// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "common/wire/internal/context.h"
#include "common/wire/internal/serialized_sample.h"

/// Writers and readers without types: what topic.cpp dresses up.
namespace cairn::wire::internal {

class WriterEntity {
 public:
  [[nodiscard]] static Result<std::unique_ptr<WriterEntity>> create(std::shared_ptr<Context> context,
                                                                    const TopicDescription& topic,
                                                                    std::string_view partition);
  /// `payload_bytes` for the statistics.
  [[nodiscard]] Status write(const void* sample, size_t payload_bytes);
  /// Makes the sample that write() would send, in a form that all writers of this topic and context can send.
  [[nodiscard]] Result<std::shared_ptr<const SerializedSample>> serialize(const void* sample,
                                                                          size_t payload_bytes) const;
  /// Writes such a sample; it may leave only with the next flush().
  [[nodiscard]] Status write(const SerializedSample& sample);
  void flush();
  [[nodiscard]] Status dispose(const void* sample);
  [[nodiscard]] int matched() const;

 private:
  WriterEntity(std::shared_ptr<Context> context, const char* topic)
      : context_(std::move(context)), topic_(topic) {}
  std::shared_ptr<Context> context_;  ///< outlives the entities below
  const char* topic_;
  Entity publisher_;
  Entity writer_;
};

class ReaderEntity {
 public:
  [[nodiscard]] static Result<std::unique_ptr<ReaderEntity>> create(std::shared_ptr<Context> context,
                                                                    const TopicDescription& topic,
                                                                    std::string_view partition);
  /// Reader of a built-in topic (DDS_BUILTIN_TOPIC_*).
  [[nodiscard]] static Result<std::unique_ptr<ReaderEntity>> create_built_in(std::shared_ptr<Context> context,
                                                                             dds_entity_t topic);

  /// Shows every sample to `visit` and removes it; at most kMaxTake. Where `visit` throws, some more that
  /// were taken with the sample are lost.
  void take(const std::function<void(const void* sample, const dds_sample_info_t& info)>& visit);
  [[nodiscard]] int matched() const;
  [[nodiscard]] int alive_writers() const;
  [[nodiscard]] std::optional<std::string> partition_of(dds_instance_handle_t publication) const;
  [[nodiscard]] std::optional<dds_guid_t> participant_of(dds_instance_handle_t publication) const;
  [[nodiscard]] uint64_t invalid() const { return invalid_; }

  /// Counts a sample that is dropped, and says so in the log.
  void report_unfit(dds_instance_handle_t publication, const std::string& reason);
  void count_received(size_t bytes) { context_->bytes_received += bytes; }
  [[nodiscard]] Context& context() const { return *context_; }
  /// Triggers while there is anything to take.
  [[nodiscard]] dds_entity_t condition() const { return condition_; }

 private:
  ReaderEntity(std::shared_ptr<Context> context, const char* topic)
      : context_(std::move(context)), topic_(topic) {}
  [[nodiscard]] Status adopt(dds_entity_t reader, const std::string& what);
  std::shared_ptr<Context> context_;
  const char* topic_;
  Entity subscriber_;
  Entity reader_;
  dds_entity_t condition_ = 0;  ///< child of reader_
  std::atomic<uint64_t> invalid_{0};
};

}  // namespace cairn::wire::internal
