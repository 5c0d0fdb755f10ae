// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <string_view>

#include "common/base/result.h"
#include "common/wire/messages.h"
#include "common/wire/participant.h"

namespace cairn::wire {

namespace internal {
class SerializedSample;
class WriterEntity;
}  // namespace internal

/// A message in the form in which it travels: made once, whatever the number of partitions in which it is
/// written, and kept once by the middleware for all who come later to any of them. Keeps its participant
/// alive. It may be copied and let go on any thread, but all writes of it, whatever the writer, must come
/// from one thread: the middleware notes the time of sending in what all of them share.
template <typename Message>
struct Serialized {
  std::shared_ptr<const internal::SerializedSample> sample;
  size_t bytes = 0;  ///< of its content
};

/// A Writer for messages that are sent alike to many clients, each in its own partition: the blocks of a map
/// (PointPatches, PointPositions, KeyframePoses). Thread-safe, but for the writes of one message
/// (Serialized).
template <typename Message>
class SerializedWriter {
 public:
  [[nodiscard]] static Result<SerializedWriter> create(const Participant& participant,
                                                       std::string_view partition);
  SerializedWriter(SerializedWriter&&) noexcept;
  SerializedWriter& operator=(SerializedWriter&&) noexcept;
  ~SerializedWriter();

  /// Serializes a message for any writer of this topic and participant. Errors as those of Writer::write().
  [[nodiscard]] Result<Serialized<Message>> serialize(const Message& message) const;
  /// Hands the message to the middleware, which neither waits for a peer nor copies it. It leaves with
  /// flush() at the latest, so that small ones share datagrams. kInternal for one that a writer of another
  /// participant has serialized.
  [[nodiscard]] Status write(const Serialized<Message>& message);
  void flush();
  /// Readers that match at this moment.
  [[nodiscard]] int matched() const;

 private:
  explicit SerializedWriter(std::unique_ptr<internal::WriterEntity> entity);
  std::unique_ptr<internal::WriterEntity> entity_;
};

}  // namespace cairn::wire
