// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <string>
#include <utility>

#include "common/map/ids.h"
#include "common/wire/partition.h"
#include "common/wire/topic.h"

namespace cairn {

/// Tells of which publications the samples of one reader are. The middleware is asked once for each
/// publication, since it looks through all of them: a sample then costs the same however many clients there
/// are. Used from one thread.
class Publications {
 public:
  struct Publication {
    std::string partition;
    std::optional<wire::PartitionIdentity> client;  ///< whose partition it is, if a client's
    ClientId client_id;                             ///< of that client's name
    std::optional<wire::PeerId> process;
  };

  /// A publication; null: it has gone meanwhile, or is in no partition or in several. Valid until the next
  /// call of forget_gone().
  [[nodiscard]] const Publication* find(const wire::ReaderBase& reader, wire::PublicationHandle handle) {
    const auto known = known_.find(handle);
    if (known != known_.end()) return &known->second;
    auto partition = reader.partition_of(handle);
    if (!partition) return nullptr;
    Publication publication{*std::move(partition), {}, {}, reader.peer_of(handle)};
    publication.client = wire::parse_partition(publication.partition);
    if (publication.client) publication.client_id = client_id_from_name(publication.client->client);
    return &known_.emplace(handle, std::move(publication)).first->second;
  }

  /// Forgets publications of writers that have gone. Asks the middleware about each: for now and then.
  void forget_gone(const wire::ReaderBase& reader) {
    std::erase_if(known_, [&](const auto& known) { return !reader.partition_of(known.first); });
  }

 private:
  std::map<wire::PublicationHandle, Publication> known_;
};

/// A reader, and the publications that its samples come from.
template <typename Message>
struct Inlet {
  wire::Reader<Message> reader;
  Publications publications{};

  [[nodiscard]] const Publications::Publication* source(const wire::Sample<Message>& sample) {
    return publications.find(reader, sample.publication);
  }
};

}  // namespace cairn
