// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "common/wire/messages.h"
#include "common/wire/rig_messages.h"
#include "server/access/principal.h"
#include "server/service/commands.h"
#include "server/service/operators.h"
#include "server/service/service_context.h"

namespace cairn {

/// The map service without a transport: it takes typed requests, each with who asks, passes them to the
/// queues of their maps and says by ServiceOutput what these decide. One access policy is asked about each.
/// The parts that an adapter uses as they are, it hands out.
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
  /// Does what is due by time; next_tick() says when to call it next.
  void tick(MonotonicTime now);
  [[nodiscard]] MonotonicTime next_tick() const { return next_tick_; }

  /// The clients, as they come and go.
  [[nodiscard]] Clients& clients() { return clients_; }
  /// The sessions of the processes that speak for clients, and their cameras.
  [[nodiscard]] Sessions& sessions() { return sessions_; }
  /// The maps as readers are sent them; all() is thread-safe.
  [[nodiscard]] const PublishedMaps& maps() const { return maps_.published(); }

  /// Commands and queries, of the process that holds the name; of others they are passed over.
  void take(const Principal& who, wire::MapSeed seed);
  void take(const Principal& who, wire::KeyframeOffer offer);
  void take(const Principal& who, wire::RelocQuery query);
  void take(const Principal& who, const wire::ClientRequest& request);
  void take(const Principal& who, const wire::AdminRequest& request);
  void take(const wire::RigState& rig);

  /// See Service.
  void publish(MapSnapshotPtr snapshot);

 private:
  void listen();
  void on_newcomer(Client& client);
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
