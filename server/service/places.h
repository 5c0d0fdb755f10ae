// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "server/service/overlap_list.h"
#include "server/service/overlap_watch.h"
#include "server/service/relocalization_runner.h"
#include "server/service/sessions.h"

namespace cairn {

/// Answers clients' queries about where they are, by the place index on the executor of queries, and keeps a
/// list of maps that show the same place. Used from the service's thread.
class Places {
 public:
  Places(const ServiceContext& context, Clients& clients, Sessions& sessions, const ServedMaps& maps);
  Places(const Places&) = delete;
  Places& operator=(const Places&) = delete;

  /// Takes a query of the process that holds the client's name; those of others are passed over.
  void take(const Principal& who, wire::RelocQuery message);
  /// Notes that a map has another revision.
  void note_revised(MapRevision revision);
  /// Notes that a map is not there any more; its overlaps stay known, since it may come back.
  void remove(MapId map) { runner_->remove(map); }
  /// The index with which a query would be answered now.
  [[nodiscard]] std::shared_ptr<const PlaceIndex> index() const { return runner_->index(); }

  /// Maps that show what is in this one, those with most keyframes first.
  [[nodiscard]] std::vector<OverlapList::Neighbour> overlaps_of(MapId map) const { return overlaps_.of(map); }
  /// Forgets the overlaps of a map that is gone for good.
  void forget_overlaps(MapId map) { overlaps_.forget(map); }
  /// Keeps the overlaps in the store if they have changed.
  void keep_overlaps();

 private:
  void watch_for_overlaps();
  void on_overlap(const Overlap& overlap);
  /// The camera to look for a place with: a camera that is announced as a guess may be known by a map.
  [[nodiscard]] CameraPtr best_known(const Client& client, uint32_t camera,
                                     const AnnouncedCamera& announced) const;
  /// Decodes a query and asks the runner. Called on a worker of the queries.
  void look_up(const std::string& client, const CameraPtr& camera, wire::RelocQuery message,
               const WearerRule::Search& search);
  void on_answered(const std::string& client_name, wire::CommandId command,
                   const RelocalizationAnswer& answer);
  void refuse(const Client& client, wire::CommandId command, std::string why);

  const ServiceContext& context_;
  Clients& clients_;
  Sessions& sessions_;
  const ServedMaps& maps_;
  std::shared_ptr<RelocalizationRunner> runner_;
  OverlapList overlaps_;
  MonotonicTime overlaps_wait_until_ = {};  ///< before, they are not written: the disk would not have them
};

}  // namespace cairn
