// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/base/utc.h"
#include "server/service/admin_json.h"

namespace cairn {

using nlohmann::json;

namespace {

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

json numbers_of(const Eigen::Vector3d& place) {
  return {place.x(), place.y(), place.z()};
}

}  // namespace

json describe(const told::Copy& copy) {
  return {{"token", copy.token}, {"bytes", copy.bytes}};
}

json describe(const told::Archive& archive) {
  json told = describe(archive.copy);
  told["name"] = archive.name;
  told["id"] = to_hex(archive.map.bytes);
  return told;
}

json describe(const told::Parts& parts) {
  ReplyPage page{"parts"};
  for (const std::string& part : parts.parts) {
    if (!page.add("parts", part)) break;
  }
  return page.content();
}

json describe(const MapTag& tag) {
  return {{"number", tag.number},       {"tag", tag.name},     {"time", to_utc(tag.time)}, {"by", tag.author},
          {"keyframes", tag.keyframes}, {"points", tag.points}};
}

json describe(const told::Tags& tags) {
  ReplyPage page{"tags"};
  page.add_all("tags", tags.tags);
  return page.content();
}

json describe(const told::Contributor& contributor) {
  return {{"client", contributor.client},
          {"keyframes", contributor.keyframes.size()},
          {"ids", ranges_of(contributor.keyframes)}};
}

json describe(const told::Contributors& contributors) {
  ReplyPage page{"contributors"};
  page.add_all("contributors", contributors.contributors);
  json told = page.content();
  told["unknown"] = contributors.unknown;
  return told;
}

json describe(const told::LabelSeen& seen) {
  const Label& label = seen.label;
  return {{"map", seen.map},
          {"id", label.id.value},
          {"kind", label.kind == LabelKind::kModel ? "model" : "text"},
          {"text", label.text},
          {"position", numbers_of(label.map_from_label.translation())},
          {"author", label.author},
          {"time", label.time.nanoseconds}};
}

json describe(const told::Labels& labels) {
  ReplyPage page{"labels"};
  page.add_all("labels", labels.labels);
  return page.content();
}

json describe(const told::ProposalSeen& seen) {
  const ProposalSummary& proposal = seen.summary;
  const SE3& pose = proposal.camera_from_map;
  return {{"id", seen.id},
          {"number", proposal.number},
          {"map", to_hex(seen.map.bytes)},
          {"map_name", seen.map_name},
          {"client", proposal.client},
          {"why", proposal.why},
          {"received", to_utc(proposal.received)},
          {"time", to_utc(proposal.time)},
          {"position", numbers_of(pose.center())},
          {"direction", numbers_of(pose.rotation_matrix().row(2))},
          {"expected", proposal.expected},
          {"found", proposal.found},
          {"bytes", proposal.bytes}};
}

json describe(const told::Proposals& proposals) {
  ReplyPage page{"proposals"};
  page.add_all("proposals", proposals.proposals);
  return page.content();
}

json describe(const ExpectedPoint& point) {
  return {std::lround(point.pixel.x()), std::lround(point.pixel.y()), point.found ? 1 : 0};
}

json describe(const told::WholeProposal& whole) {
  json told = describe(whole.proposal);
  told["picture_bytes"] = whole.image_bytes;
  told["measured"] = whole.measured;
  if (!whole.expected_now) {
    told["problem"] = whole.expected_now.error().message;
    return told;
  }
  const std::vector<ExpectedPoint>& points = *whole.expected_now;
  told["expected_now"] = points.size();
  told["found_now"] = std::ranges::count_if(points, &ExpectedPoint::found);
  told["points"] = list_of(points);
  return told;
}

json describe(const told::AcceptedProposal& accepted) {
  return {{"id", accepted.id},
          {"map", to_hex(accepted.map.bytes)},
          {"client", accepted.client},
          {"keyframe", accepted.keyframe.value}};
}

}  // namespace cairn
