// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "common/base/result.h"
#include "common/wire/messages.h"
#include "common/wire/participant.h"
#include "common/wire/peers.h"

/// Typed writers and readers of the topics of idl/README.md, for each struct of messages.h. QoS goes with the
/// topic and is stated in one place (internal/qos.cpp).
namespace cairn::wire {

/// Why an instance is gone.
enum class Gone : uint8_t {
  kDisposed,   ///< its writer has removed it
  kNoWriters,  ///< its last writer has left, crashed or fallen silent
};

template <typename Message>
struct Sample {
  std::optional<Message> message;  ///< nothing: the instance is gone
  Gone gone = Gone::kDisposed;     ///< why, without message
  Message key;                     ///< without message: the key members only
  PublicationHandle publication;   ///< who wrote it
};

namespace internal {
class WriterEntity;
class ReaderEntity;
}  // namespace internal

/// Writes one topic in one partition. Destruction leaves instances behind as kNoWriters. Thread-safe.
template <typename Message>
class Writer {
 public:
  [[nodiscard]] static Result<Writer> create(const Participant& participant, std::string_view partition);
  Writer(Writer&&) noexcept;
  Writer& operator=(Writer&&) noexcept;
  ~Writer();

  /// Hands the message to the middleware. Never waits for a peer: all writers are KEEP_LAST (internal/qos.h).
  /// kInternal for a message beyond the bounds of the wire (idl/cairn.idl); kRefused for one that is larger
  /// than any peer takes (internal/configuration.h), with its topic and size.
  [[nodiscard]] Status write(const Message& message);
  /// Removes the instance of this key.
  [[nodiscard]] Status dispose(const Message& key);
  /// Readers that match at this moment.
  [[nodiscard]] int matched() const;

 private:
  explicit Writer(std::unique_ptr<internal::WriterEntity> entity);
  std::unique_ptr<internal::WriterEntity> entity_;
};

/// What every reader can tell, whatever its topic.
class ReaderBase {
 public:
  ReaderBase(ReaderBase&&) noexcept;
  ReaderBase& operator=(ReaderBase&&) noexcept;
  virtual ~ReaderBase();

  /// Writers that match at this moment, and those of them that assert their liveliness within its lease.
  /// Cheap to poll.
  [[nodiscard]] int matched() const;
  [[nodiscard]] int alive_writers() const;
  /// Samples dropped so far because they failed validation.
  [[nodiscard]] uint64_t invalid() const;
  /// The one partition of a publication: with DDS Security on, its proven identity. Nothing when it has gone,
  /// or is in several partitions or in none.
  [[nodiscard]] std::optional<std::string> partition_of(PublicationHandle publication) const;
  /// The participant whose publication it is; nothing when it has gone.
  [[nodiscard]] std::optional<PeerId> peer_of(PublicationHandle publication) const;

  [[nodiscard]] const internal::ReaderEntity& entity() const { return *entity_; }

 protected:
  explicit ReaderBase(std::unique_ptr<internal::ReaderEntity> entity);
  std::unique_ptr<internal::ReaderEntity> entity_;
};

/// Reads one topic in one partition (or those that a wildcard matches). One thread takes; the rest is
/// thread-safe.
template <typename Message>
class Reader : public ReaderBase {
 public:
  [[nodiscard]] static Result<Reader> create(const Participant& participant, std::string_view partition);

  /// Removes and returns what has come, at most a few hundred samples at a time: call again until empty. In
  /// the order of writing per writer. Samples that fail validation are dropped, counted and logged.
  [[nodiscard]] std::vector<Sample<Message>> take();

 private:
  using ReaderBase::ReaderBase;
};

/// Calls of take() in a row: who sends faster than samples are used must not starve the thread's other work.
/// What is left wakes the Waiter again at once.
inline constexpr int kTakesInARow = 16;

/// Hands each sample that has come to `use`, until there are no more or others must have their turn.
template <typename Message, typename Use>
void take_all(Reader<Message>& reader, const Use& use) {
  for (int i = 0; i < kTakesInARow; ++i) {
    auto samples = reader.take();
    if (samples.empty()) return;
    for (Sample<Message>& sample : samples) use(sample);
  }
}

/// A writer or reader of each of the types, all in one partition; else why the first that failed did.
template <typename... Endpoints>
[[nodiscard]] Result<std::tuple<Endpoints...>> create_all(const Participant& participant,
                                                          std::string_view partition) {
  return std::apply(
      [](auto&&... made) -> Result<std::tuple<Endpoints...>> {
        Status status;
        ((status&& !made ? status = tl::unexpected(made.error()) : status), ...);
        if (!status) return tl::unexpected(status.error());
        return std::tuple<Endpoints...>(*std::move(made)...);
      },
      std::tuple<Result<Endpoints>...>{Endpoints::create(participant, partition)...});
}

}  // namespace cairn::wire
