// SPDX-License-Identifier: Apache-2.0
#include "server/store/compact_map.h"

#include "server/store/rewrite_map.h"

namespace cairn {
namespace {

/// A keyframe that was removed since is none any more; that it was accepted stays.
void renumber_decisions(const Renumbering& now, std::vector<DecisionRecord>* decisions) {
  for (DecisionRecord& d : *decisions) {
    d.keyframe = now.of(d.keyframe);
    for (auto& [trail, point] : d.seed_points) point = now.of(point);
    std::erase_if(d.seed_points, [](const auto& of_trail) { return !of_trail.second; });
  }
}

}  // namespace

Status compact_map(Store* store, MapId map, const AcceptState& accept) {
  auto file = MapFile::open(store->path_of(map));
  if (!file) return tl::unexpected(file.error());
  const auto tags = file->tags();
  if (!tags) return tl::unexpected(tags.error());
  if (!tags->empty())
    return fail(ErrorCode::kRefused, "it has tags, which would go with its old ids; `cairnctl map ID untag`");
  const auto nothing = [](const StoredMap&, MapState*) { return Status(); };
  return rewrite_map(store, map, {nothing, renumber_decisions, {}, false}, accept);
}

}  // namespace cairn
