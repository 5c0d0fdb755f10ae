// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/wire/messages.h"
#include "common/wire/peers.h"
#include "common/wire/rig_messages.h"
#include "server/access/principal.h"
#include "server/service/commands.h"
#include "server/service/operators.h"
#include "server/service/service_context.h"

namespace cairn {

/// What a reader of a map has at first; what comes then, ServiceOutput tells.
struct FollowedMap {
  MapSnapshotPtr newest;
  std::vector<wire::LabelMessage> labels;
};

/// The map service without a transport: it takes typed requests, each with who asks, passes them to the
/// queues of their maps and says by ServiceOutput what these decide. One access policy is asked about each.
/// Nothing here is shared: all is called on one thread, the home of the service, unless said otherwise.
class MapService {
 public:
  using Executors = ServiceExecutors;
  /// The executors, `store` (null: nothing is kept), `site`, `output` and what `post` needs outlive the
  /// service.
  MapService(const MapServiceOptions& options, Executors executors, MapPersistence* store, SiteAccess& site,
             ServiceOutput& output, Post post, Logger log);
  MapService(const MapService&) = delete;
  MapService& operator=(const MapService&) = delete;

  /// Serves all `restored` maps. Before anything else.
  void resume(std::vector<RestoredMap> restored);
  /// Tells the maps to stop: running work ends soon.
  void stop();
  /// Hands what has changed in all maps to the store. After stop(), when the executors have ended.
  void save_last_changes();
  /// What is due by time; when the next is, next_tick() says.
  void tick(MonotonicTime now);
  [[nodiscard]] MonotonicTime next_tick() const { return next_tick_; }

  /// A client listens: it is told what there is. And does so no more.
  void connect(const Principal& who);
  void disconnect(const Principal& who);
  /// Of such clients, what they have offered and no map has judged yet is not taken any more.
  void withdraw_offers(const std::function<bool(const std::string& client)>& is_turned_away);
  /// Somebody is not heard, or is not any more, though he speaks: for the audit log.
  void note_turned_away(const Principal& who, const std::string& why);
  /// Somebody was not let in by the transport, as who he says he is: for the audit log.
  void note_refused(const std::string& who, const std::string& why);
  /// Its process is not heard any more.
  void fell_silent(ClientId client);
  /// From a process under this name; more of them may send.
  void take(const Principal& who, wire::PeerId process, const wire::CameraMessage& camera);
  /// Whether it counts: another live process may hold the name.
  bool take(const Principal& who, wire::PublicationHandle publication, std::optional<wire::PeerId> process,
            const wire::TrackerStateMessage& state);
  /// Commands and queries, of the process that holds the name; of others they are passed over.
  void take(const Principal& who, wire::MapSeed seed);
  void take(const Principal& who, wire::KeyframeOffer offer);
  void take(const Principal& who, wire::RelocQuery query);
  void take(const Principal& who, const wire::ClientRequest& request);
  void take(const Principal& who, const wire::AdminRequest& request);
  void take(const wire::RigState& rig);
  /// Nothing where there is no such map for this client (yet).
  [[nodiscard]] std::optional<FollowedMap> follow(const Principal& who, MapId map) const;

  /// See Service.
  void publish(MapSnapshotPtr snapshot);
  /// Thread-safe.
  [[nodiscard]] std::vector<MapSnapshotPtr> maps() const;

 private:
  void listen();
  void on_map_shown(MapId map, MapEntry& entry, MapRevision revision);
  void on_map_gone(MapId map, bool was_shown);

  // Each knows those above it that it needs, and none below.
  const ServiceContext context_;
  ServedMaps maps_;
  Capacity capacity_;
  Clients clients_;
  Sessions sessions_;
  Proposals proposals_;
  MapNews news_;
  Labels labels_;
  Places places_;
  Commands commands_;
  RigList rigs_;
  Health health_;
  Overview overview_;
  MapAdministration map_administration_;
  Archives archives_;
  MapVersions versions_;
  StoreAdministration store_administration_;
  SiteAdministration site_administration_;
  LabelAdministration label_administration_;
  ProposalAdministration proposal_administration_;
  Operators operators_;
  MonotonicTime next_tick_;
  int ticks_ = 0;
};

}  // namespace cairn
