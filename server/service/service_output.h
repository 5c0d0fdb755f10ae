// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <variant>

#include "common/map/snapshot.h"
#include "common/wire/messages.h"

namespace cairn {

/// A map is not there any more, or not for this client: it is sent no more of it.
struct MapUnlisted {
  MapId map;
  bool was_listed = true;  ///< else its name is not to be learnt from this either
};
/// Withdraws the estimate of a client's camera that self-calibration in a map had made.
struct EstimateDropped {
  ClientId client;
  uint32_t camera = 0;
  MapId map;
};

/// An event that one client is told. Of each kind the newest counts (of maps and cameras: of each of those).
using ClientEvent =
    std::variant<wire::ServerStatus, wire::MapInfo, MapUnlisted, wire::SeedVerdict, wire::OfferVerdict,
                 wire::RelocAnswer, wire::CameraEstimate, EstimateDropped, wire::ClientReply>;

/// What the map service brings about outside: an adapter carries it out, by DDS or in the same process.
/// Called on the service's thread, and never waits for a peer.
class ServiceOutput {
 public:
  virtual ~ServiceOutput() = default;

  /// Tells an event to a client that is connected; MapUnlisted also to others, whose readers of the map may
  /// be there. Error: it could not be written, and is lost.
  [[nodiscard]] virtual Status tell(const std::string& client, const ClientEvent& event) = 0;
  /// Answers an operator; the same answer once more where he asks again.
  [[nodiscard]] virtual Status answer(const std::string& operator_name, const wire::AdminReply& reply) = 0;

  /// Shows another revision of a map, its first perhaps, to all that follow it (PublishedMaps::follow()).
  virtual void revised(MapId map, const MapSnapshotPtr& newest) = 0;
  virtual void labelled(const wire::LabelMessage& label) = 0;
  virtual void label_removed(MapId map, LabelId label) = 0;
  /// Ends the feeds of a map that is not there any more.
  virtual void ended(MapId map) = 0;
};

}  // namespace cairn
