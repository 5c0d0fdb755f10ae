// SPDX-License-Identifier: Apache-2.0
#include "server/service/admin_pages.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "common/base/utc.h"
#include "server/service/proposal_book.h"
#include "server/store/backup.h"
#include "server/store/store_check.h"

namespace cairn {
namespace {

using nlohmann::json;

/// "1-3 7 9-12", cut short where it is very long.
std::string ranges_of(const std::vector<uint64_t>& ascending) {
  constexpr size_t kMostBytes = 2000;
  std::string text;
  for (size_t i = 0; i < ascending.size() && text.size() < kMostBytes;) {
    size_t last = i;
    while (last + 1 < ascending.size() && ascending[last + 1] == ascending[last] + 1) ++last;
    text += fmt::format("{}{}", text.empty() ? "" : " ", ascending[i]);
    if (last > i) text += fmt::format("-{}", ascending[last]);
    i = last + 1;
  }
  return text.size() < kMostBytes ? text : text + " ...";
}

json place_of(const Eigen::Vector3d& place) {
  return {place.x(), place.y(), place.z()};
}

}  // namespace

json describe(const MapTag& tag) {
  return {{"number", tag.number},       {"tag", tag.name},     {"time", to_utc(tag.time)}, {"by", tag.author},
          {"keyframes", tag.keyframes}, {"points", tag.points}};
}

wire::AdminReply page_of(std::span<const MapTag> tags, uint64_t after) {
  ReplyPage page{"tags"};
  for (const MapTag& tag : tags) {
    if (tag.number > after && !page.add("tags", describe(tag))) break;
  }
  return success(page.content());
}

Contributors contributors_of(const MapSnapshot& map, std::span<const Contribution> known) {
  Contributors contributors;
  contributors.others = map.keyframe_count();
  for (const auto& [keyframe, client] : known) {
    if (map.find(keyframe) == nullptr) continue;
    contributors.by_client[client].push_back(keyframe.value);
    --contributors.others;
  }
  return contributors;
}

wire::AdminReply page_of(const Contributors& contributors, const std::string& after) {
  ReplyPage page{"contributors"};
  for (const auto& [client, keyframes] : contributors.by_client) {
    const json told{{"client", client}, {"keyframes", keyframes.size()}, {"ids", ranges_of(keyframes)}};
    if (client > after && !page.add("contributors", told)) break;
  }
  json told = page.content();
  told["unknown"] = contributors.others;
  return success(told);
}

wire::AdminReply page_of(std::span<const std::string> parts, const std::string& after) {
  ReplyPage page{"parts"};
  for (const std::string& part : parts) {  // that one may have gone meanwhile
    if ((after.empty() || comes_later(part, after)) && !page.add("parts", part)) break;
  }
  return success(page.content());
}

json describe(MapId map, const std::string& map_name, const ProposalSummary& proposal) {
  const SE3& pose = proposal.camera_from_map;
  return {{"id", proposal_id(map, proposal.number)},
          {"number", proposal.number},
          {"map", to_hex(map.bytes)},
          {"map_name", map_name},
          {"client", proposal.client},
          {"why", proposal.why},
          {"received", to_utc(proposal.received)},
          {"time", to_utc(proposal.time)},
          {"position", place_of(pose.center())},
          {"direction", place_of(pose.rotation_matrix().row(2))},
          {"expected", proposal.expected},
          {"found", proposal.found},
          {"bytes", proposal.bytes}};
}

json describe(std::span<const ExpectedPoint> points) {
  json told = json::array();
  for (const ExpectedPoint& p : points)
    told.push_back({std::lround(p.pixel.x()), std::lround(p.pixel.y()), p.found ? 1 : 0});
  return told;
}

}  // namespace cairn
