// SPDX-License-Identifier: Apache-2.0
#include "server/store/drop_contributor.h"

#include <algorithm>
#include <set>

#include "server/store/rewrite_map.h"

namespace cairn {
namespace {

constexpr size_t kFewestKeyframes = 2;

std::set<KeyframeId> keyframes_of(const StoredMap& map, const std::string& client) {
  std::set<KeyframeId> keyframes;
  for (const auto& [keyframe, contributor] : map.contributions) {
    if (contributor == client) keyframes.insert(keyframe);
  }
  return keyframes;
}

/// Removes ids from decisions, and the client's own decisions: after the rewrite old ids have no meaning any
/// more. That commands of others were decided stays.
void forget_ids(const std::string& client, std::vector<DecisionRecord>* decisions) {
  std::erase_if(*decisions, [&](const DecisionRecord& d) { return d.client == client; });
  for (DecisionRecord& d : *decisions) {
    d.keyframe = {};
    d.seed_points.clear();
  }
}

Status take_out_keyframes_of(const std::string& client, const StoredMap& stored, MapState* state) {
  size_t gone = 0;
  for (const KeyframeId id : keyframes_of(stored, client)) {
    if (!state->is_live(id)) continue;
    state->remove_keyframe(id);
    ++gone;
  }
  if (gone == 0) return tl::unexpected(no_contribution(client, stored.header.name));
  if (state->live_keyframes() >= kFewestKeyframes) return {};
  return fail(ErrorCode::kRefused, "nothing would be left of map " + stored.header.name + "; `cairnctl map " +
                                       stored.header.name + " delete` and `cairnctl maps purge`");
}

}  // namespace

Error no_contribution(const std::string& client, const std::string& map_name) {
  return {ErrorCode::kNotFound, "client '" + client + "' has no keyframe in map " + map_name +
                                    "; `cairnctl map " + map_name + " contributors` lists who has"};
}

Status drop_contributor(Store* store, MapId map, const std::string& client, const AcceptState& accept) {
  const auto take_out = [&client](const StoredMap& stored, MapState* state) {
    return take_out_keyframes_of(client, stored, state);
  };
  const auto follow = [&client](const Renumbering&, std::vector<DecisionRecord>* decisions) {
    forget_ids(client, decisions);
  };
  return rewrite_map(store, map, {take_out, follow, client, true}, accept);
}

}  // namespace cairn
