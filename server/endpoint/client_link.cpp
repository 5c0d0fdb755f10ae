// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/client_link.h"

#include <utility>

#include "common/wire/limits.h"
#include "common/wire/partition.h"
#include "server/service/command_gate.h"

namespace cairn {
namespace {

// What a client has sent and nobody has acknowledged is still there to be sent again.
static_assert(OfferGate::kMaxAhead < wire::kCommandDepth);

/// Writes an event to the right one of a client's writers.
struct Dispatch {
  ClientWriters& to;
  Status operator()(const wire::ServerStatus& status) const { return to.status.write(status); }
  Status operator()(const wire::MapInfo& info) const { return to.maps.write(info); }
  Status operator()(const MapUnlisted& gone) const {
    if (!gone.was_listed) return {};
    wire::MapInfo key;
    key.map = gone.map;
    return to.maps.dispose(key);
  }
  Status operator()(const wire::SeedVerdict& verdict) const { return to.seeds.write(verdict); }
  Status operator()(const wire::OfferVerdict& verdict) const { return to.offers.write(verdict); }
  Status operator()(const wire::RelocAnswer& answer) const { return to.places.write(answer); }
  Status operator()(const wire::CameraEstimate& estimate) const { return to.cameras.write(estimate); }
  Status operator()(const EstimateDropped& gone) const {
    wire::CameraEstimate key;
    key.client = gone.client;
    key.camera = gone.camera;
    key.map = gone.map;
    return to.cameras.dispose(key);
  }
  Status operator()(const wire::ClientReply& reply) const { return to.replies.write(reply); }
};

}  // namespace

Result<ClientWriters> ClientWriters::create(const wire::Participant& participant, const std::string& client) {
  auto writers =
      wire::create_all<wire::Writer<wire::ServerStatus>, wire::Writer<wire::MapInfo>,
                       wire::Writer<wire::SeedVerdict>, wire::Writer<wire::OfferVerdict>,
                       wire::Writer<wire::RelocAnswer>, wire::Writer<wire::CameraEstimate>,
                       wire::Writer<wire::ClientReply>>(participant, wire::client_partition(client));
  if (!writers) return tl::unexpected(writers.error());
  auto& [status, maps, seeds, offers, places, cameras, replies] = *writers;
  return ClientWriters{std::move(status), std::move(maps),    std::move(seeds),  std::move(offers),
                       std::move(places), std::move(cameras), std::move(replies)};
}

Status write(ClientWriters& writers, const ClientEvent& event) {
  return std::visit(Dispatch{writers}, event);
}

void note_author(const ClientEvent& verdict, ClientLink* link) {
  if (const auto* seed = std::get_if<wire::SeedVerdict>(&verdict); seed != nullptr && seed->accepted)
    link->authored.insert(seed->map);
  const auto* offers = std::get_if<wire::OfferVerdict>(&verdict);
  if (offers == nullptr) return;
  for (const wire::OfferOutcome& outcome : offers->recent)
    if (outcome.decision == wire::OfferDecision::kAccepted) link->authored.insert(outcome.map);
}

}  // namespace cairn
