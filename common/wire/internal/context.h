// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "common/base/log.h"
#include "common/wire/internal/entity.h"
#include "common/wire/internal/qos.h"
#include "common/wire/participant.h"
#include "common/wire/security.h"

namespace cairn::wire::internal {

/// Name, type and QoS of a topic.
struct TopicDescription {
  const char* name = nullptr;
  const dds_topic_descriptor_t* type = nullptr;
  QosClass qos_class = QosClass::kState;
};

/// The domain, the participant and the topics of a Participant. Thread-safe.
class Context {
 public:
  [[nodiscard]] static Result<std::shared_ptr<Context>> create(const ParticipantOptions& options);

  [[nodiscard]] dds_entity_t participant() const { return participant_; }
  [[nodiscard]] const NetworkPath& path() const { return path_; }
  /// Whether what is written may wait until its writer is flushed.
  [[nodiscard]] bool writes_in_batches() const { return writes_in_batches_; }
  [[nodiscard]] std::optional<Timestamp> good_until() const {
    return security_ ? std::optional(security_->expires) : std::nullopt;
  }
  /// The middleware's topic, made when first asked for; it lives as long as the context. Errors:
  /// kConfiguration when our keys have expired, and nothing more can be made here; kInternal when the
  /// middleware makes none.
  [[nodiscard]] Result<dds_entity_t> topic(const TopicDescription& description);
  /// The middleware's type by which the samples of a topic are serialized; it lives as long as the context.
  /// `writer`: any writer of the topic here. Errors as topic(); kInternal when the middleware does not tell
  /// it.
  [[nodiscard]] Result<const ddsi_sertype*> sertype(const char* topic, dds_entity_t writer);

  /// Logs that samples of a topic are dropped, at most once a minute for each topic.
  void report_unfit(const char* topic, const std::string& partition, const std::string& reason);

  std::atomic<uint64_t> bytes_sent{0};
  std::atomic<uint64_t> bytes_received{0};

 private:
  Context(Entity domain, dds_entity_t participant, NetworkPath path, std::optional<Security> security,
          bool writes_in_batches, Logger log)
      : path_(std::move(path)),
        writes_in_batches_(writes_in_batches),
        security_(std::move(security)),
        domain_(std::move(domain)),
        participant_(participant),
        log_(std::move(log)) {}
  /// Checks our keys. Error kConfiguration: they have expired, or do in a moment.
  [[nodiscard]] Status check_keys() const;

  const NetworkPath path_;
  const bool writes_in_batches_;
  const std::optional<Security> security_;
  Entity domain_;  ///< owns the rest
  dds_entity_t participant_ = 0;
  std::mutex mutex_;
  std::map<std::string, dds_entity_t, std::less<>> topics_;
  std::map<std::string, const ddsi_sertype*, std::less<>> sertypes_;  ///< by topic
  struct Unfit {
    std::chrono::steady_clock::time_point logged_at;
    int passed_over = 0;  ///< since then
  };
  Logger log_;
  std::map<std::string, Unfit, std::less<>> unfit_;  ///< by topic
};

}  // namespace cairn::wire::internal
