// SPDX-License-Identifier: Apache-2.0
#include "server/service/proposal_registry.h"

#include <algorithm>

namespace cairn {
namespace {

constexpr double kAlikeDistance = 0.1;     ///< of the depth, between camera centres
constexpr double kAlikeDirection = 0.966;  ///< cosine between optical axes: 15 degrees
constexpr size_t kDigits = 8;
constexpr size_t kManyClients = 1000;  ///< from which those that may be looked at again are forgotten

struct Sum {
  size_t count = 0;
  uint64_t bytes = 0;
};

Sum sum_of(const ProposalRegistry::OfMap& proposals) {
  Sum sum;
  for (const auto& [number, proposal] : proposals) sum = {sum.count + 1, sum.bytes + proposal.bytes};
  return sum;
}

std::map<std::string, Sum> by_client(const ProposalRegistry::OfMap& proposals) {
  std::map<std::string, Sum> sums;
  for (const auto& [number, proposal] : proposals) {
    Sum& sum = sums[proposal.client];
    sum = {sum.count + 1, sum.bytes + proposal.bytes};
  }
  return sums;
}

Eigen::Vector3d axis_of(const SE3& camera_from_map) {
  return camera_from_map.rotation_matrix().row(2);
}

}  // namespace

void ProposalRegistry::restore(MapId map, std::vector<ProposalSummary> proposals, uint64_t last) {
  MapPart& part = maps_[map];
  part = {std::max(part.last, last), {}};
  for (ProposalSummary& proposal : proposals) {
    part.last = std::max(part.last, proposal.number);
    part.proposals.emplace(proposal.number, std::move(proposal));
  }
}

void ProposalRegistry::forget(MapId map) {
  maps_.erase(map);
}

std::string ProposalRegistry::why_not_now(const std::string& client, MonotonicTime now) {
  if (looked_at_.size() > kManyClients)
    std::erase_if(looked_at_, [&](const auto& entry) { return now - entry.second >= limits_.interval; });
  const auto before = looked_at_.find(client);
  if (before != looked_at_.end() && now - before->second < limits_.interval)
    return "proposals come too fast: one of a client is looked at every " +
           std::to_string(limits_.interval.count()) + " ms";
  looked_at_[client] = now;
  return {};
}

std::string ProposalRegistry::why_full() const {
  uint64_t bytes = 0;
  for (const auto& [map, part] : maps_) bytes += sum_of(part.proposals).bytes;
  if (bytes < limits_.bytes_in_all) return {};
  return "the server keeps " + std::to_string(bytes / 1'000'000) +
         " MB of proposals, and no more until some have been accepted or dropped";
}

const ProposalSummary* ProposalRegistry::find_alike(MapId map, const ProposalSummary& proposal) const {
  const Eigen::Vector3d center = proposal.camera_from_map.center();
  const Eigen::Vector3d axis = axis_of(proposal.camera_from_map);
  for (const auto& [number, other] : of(map)) {
    const double distance = (other.camera_from_map.center() - center).norm();
    if (distance < kAlikeDistance * proposal.mean_depth &&
        axis.dot(axis_of(other.camera_from_map)) > kAlikeDirection)
      return &other;
  }
  return nullptr;
}

ProposalRegistry::OfMap::const_iterator ProposalRegistry::next_to_go(const OfMap& proposals,
                                                                     const std::string& client) const {
  const auto sums = by_client(proposals);
  const auto oldest_of = [&](const std::string& name) {
    return std::find_if(proposals.begin(), proposals.end(),
                        [&](const auto& entry) { return entry.second.client == name; });
  };
  const auto own = sums.find(client);
  if (own != sums.end() &&
      (own->second.count > limits_.per_client || own->second.bytes > limits_.bytes_per_client))
    return oldest_of(client);
  const Sum all = sum_of(proposals);
  if (all.count <= limits_.per_map && all.bytes <= limits_.bytes_per_map) return proposals.end();
  const auto most = std::max_element(
      sums.begin(), sums.end(), [](const auto& a, const auto& b) { return a.second.bytes < b.second.bytes; });
  return oldest_of(most->first);
}

ProposalRegistry::Room ProposalRegistry::add(MapId map, ProposalSummary proposal) {
  MapPart& part = maps_[map];
  Room room{++part.last, {}};
  proposal.number = room.number;
  const std::string client = proposal.client;
  part.proposals.emplace(room.number, std::move(proposal));
  for (auto next = next_to_go(part.proposals, client);
       next != part.proposals.end() && next->first != room.number;
       next = next_to_go(part.proposals, client)) {
    room.gone.push_back(next->second);
    part.proposals.erase(next);
  }
  return room;
}

void ProposalRegistry::take_back(MapId map, const Room& room) {
  const auto part = maps_.find(map);
  if (part == maps_.end()) return;
  part->second.proposals.erase(room.number);
  for (const ProposalSummary& proposal : room.gone) part->second.proposals.emplace(proposal.number, proposal);
}

void ProposalRegistry::remove(MapId map, uint64_t number) {
  if (const auto part = maps_.find(map); part != maps_.end()) part->second.proposals.erase(number);
}

std::map<MapId, std::vector<uint64_t>> ProposalRegistry::too_old(Timestamp now) const {
  const int64_t keep = std::chrono::nanoseconds(limits_.keep).count();
  std::map<MapId, std::vector<uint64_t>> old;
  for (const auto& [map, part] : maps_) {
    for (const auto& [number, proposal] : part.proposals)
      if (now.nanoseconds - proposal.received.nanoseconds > keep) old[map].push_back(number);
  }
  return old;
}

const ProposalRegistry::OfMap& ProposalRegistry::of(MapId map) const {
  static const OfMap none;
  const auto part = maps_.find(map);
  return part == maps_.end() ? none : part->second.proposals;
}

const ProposalSummary* ProposalRegistry::find(MapId map, uint64_t number) const {
  const OfMap& proposals = of(map);
  const auto found = proposals.find(number);
  return found == proposals.end() ? nullptr : &found->second;
}

size_t ProposalRegistry::count() const {
  size_t count = 0;
  for (const auto& [map, part] : maps_) count += part.proposals.size();
  return count;
}

std::string proposal_id(MapId map, uint64_t number) {
  return to_hex(map.bytes).substr(0, kDigits) + "-" + std::to_string(number);
}

}  // namespace cairn
