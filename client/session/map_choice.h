// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <map>
#include <optional>
#include <string>

#include "client/session/link_monitor.h"
#include "client/session/map_directory.h"
#include "common/map/label.h"
#include "common/map/snapshot.h"

namespace cairn {

/// A revision that must be swapped in before a lockstep client goes on.
struct RequiredRevision {
  MapId map;
  Epoch epoch;
  Revision revision;
};

/// The server's map that a client uses, and the newest whole revisions of those that it used of late: they go
/// on being received, so that switching back to one takes no time. Pure. One thread.
class MapChoice {
 public:
  /// `recent`: so many are received. `only`: the name of the one map to be used; empty: any.
  MapChoice(size_t recent, std::string only) : recent_limit_(recent), only_(std::move(only)) {}

  [[nodiscard]] MapId in_use() const { return in_use_; }
  /// The maps that are to be received, the one chosen last first.
  [[nodiscard]] const std::deque<MapId>& recent() const { return recent_; }
  [[nodiscard]] bool is_recent(MapId map) const;
  /// Whether the client uses one map only, which it was told by name.
  [[nodiscard]] bool is_bound() const { return !only_.empty(); }
  /// Uses a map from now on; none: no map. False: it is in use already.
  bool choose(MapId map);

  void listed(MapId map, const std::string& name) { directory_.listed(map, name); }
  void removed(MapId map) { directory_.removed(map); }
  /// The map of the one name, of those that the server in sight has; none: there is none (yet).
  [[nodiscard]] MapId only(const LinkMonitor& monitor) const { return directory_.find(only_, monitor); }

  /// A whole revision of a map that is received. True: it is that of the map in use.
  bool swap_in(const MapSnapshotPtr& revision);
  /// The newest revision of the map in use or, until its first one is there, of the one before; null without
  /// any.
  [[nodiscard]] const MapSnapshotPtr& snapshot() const { return snapshot_; }
  /// The newest revision of the map in use; null before its first.
  [[nodiscard]] MapSnapshotPtr replica_in_use() const;

  void set_labels(MapId map, LabelListPtr labels);
  [[nodiscard]] LabelListPtr labels(MapId map) const;

  /// A revision is to be waited for, unless a later one of its map is or another map is in use: the server
  /// tells its latest verdict on offers again with each one on a seed, and what that asks for is over.
  void require(const RequiredRevision& wanted);
  /// Whether the revision that is to be waited for is swapped in.
  [[nodiscard]] bool is_current() const;

 private:
  const size_t recent_limit_;
  const std::string only_;
  MapDirectory directory_;
  MapId in_use_;
  std::deque<MapId> recent_;
  std::map<MapId, MapSnapshotPtr> replicas_;
  std::map<MapId, LabelListPtr> labels_;
  MapSnapshotPtr snapshot_;
  std::optional<RequiredRevision> required_;
};

}  // namespace cairn
