// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "server/mapping/map_maker_options.h"
#include "server/mapping/map_state.h"

/// Cuts a map into the immutable blocks of common/map, renewing only what changed enough to be seen.
namespace cairn {

/// Not thread-safe; the snapshots it gives are.
class SnapshotBuilder {
 public:
  SnapshotBuilder(MapId map, std::string name, Epoch epoch, const PublicationOptions& options)
      : map_(map), name_(std::move(name)), epoch_(epoch), options_(options) {}

  /// Gives the map a name, which the next snapshot has.
  void rename(std::string name) { name_ = std::move(name); }

  /// Returns the map as of now. A block is new if a point or keyframe in it is new or gone, moved since the
  /// block was cut by more than what spans `visible_move` at the source keyframe's distance (the mean depth,
  /// for a keyframe), or is now seen from notably elsewhere. Versions of new blocks are the revision's
  /// number. If nothing has changed the previous snapshot is returned again.
  [[nodiscard]] MapSnapshotPtr build(const MapState& map);

 private:
  MapId map_;
  std::string name_;
  Epoch epoch_;
  PublicationOptions options_;
  MapSnapshotPtr previous_;
};

}  // namespace cairn
