// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/log.h"
#include "common/base/rate_limit.h"
#include "common/wire/discovered.h"
#include "common/wire/participant.h"
#include "common/wire/rig_messages.h"
#include "common/wire/topic.h"
#include "common/wire/waiter.h"
#include "server/endpoint/client_link.h"
#include "server/endpoint/doorkeeper.h"
#include "server/endpoint/feed_turns.h"
#include "server/endpoint/publications.h"
#include "server/endpoint/service.h"
#include "server/service/map_service.h"

namespace cairn {

/// The map service in a DDS domain, on a thread of its own: takes samples, identifies who sent them by the
/// partition of the publication, and writes what the service says to the partitions of those whom it
/// concerns. Whatever is not said to be thread-safe belongs to that thread.
class Endpoint : private ServiceOutput {
 public:
  /// Starts the endpoint. On return all `restored` maps are served.
  [[nodiscard]] static Result<std::unique_ptr<Endpoint>> start(const ServiceOptions& options,
                                                               MapService::Executors executors,
                                                               MapPersistence* store, SiteAccess& site,
                                                               SiteKeys keys,
                                                               std::vector<RestoredMap> restored, Logger log);
  ~Endpoint() override { stop(); }
  Endpoint(const Endpoint&) = delete;
  Endpoint& operator=(const Endpoint&) = delete;

  /// Ends the thread and tells the maps to stop. Running work may call the service's Post until its executor
  /// has ended: outlive the executors.
  void stop();
  /// See Service. Thread-safe.
  void publish(MapSnapshotPtr snapshot);
  [[nodiscard]] std::vector<MapSnapshotPtr> maps() const { return service_.maps().all(); }
  [[nodiscard]] const wire::NetworkPath& network() const { return participant_.path(); }
  /// Hands what has changed in all maps to the store. After stop(), when the executors have ended.
  void save_last_changes() { service_.save_last_changes(); }

 private:
  struct Readers {
    wire::DiscoveredReaders discovered;
    wire::DiscoveredParticipants participants;
    Inlet<wire::CameraMessage> cameras;
    Inlet<wire::TrackerStateMessage> states;
    Inlet<wire::MapSeed> seeds;
    Inlet<wire::KeyframeOffer> offers;
    Inlet<wire::RelocQuery> queries;
    Inlet<wire::ClientRequest> client_requests;
    Inlet<wire::AdminRequest> requests;
    Inlet<wire::RigState> rigs;
    wire::Waiter waiter;
  };
  [[nodiscard]] static Result<Readers> make_readers(const wire::Participant& participant);
  Endpoint(const ServiceOptions& options, MapService::Executors executors, MapPersistence* store,
           SiteAccess& site, SiteKeys keys, wire::Participant participant, Readers readers, Logger log);

  // The loop.
  void run();
  [[nodiscard]] std::chrono::milliseconds time_to_wait() const;
  void post(Task task);
  void run_posted();
  void take_messages();
  template <typename Message, typename Use>
  void take_commands(Inlet<Message>* inlet, const Use& use);
  void take_queries();
  void take_states();
  void take_requests();
  void take_rigs();
  void feed_clients();
  void forget_gone_publications();

  // Who is there.
  void take_participants();
  void on_discovered(const wire::DiscoveredReader& reader);
  void connect(const std::string& name, ClientLink* link);
  void disconnect(const std::string& name, ClientLink* link);
  void look_who_is_at_the_door(MonotonicTime now);
  /// Follows a change of the register: keys were revoked, or a name whose keys were revoked has keys again.
  void look_who_is_turned_away();
  /// Whether somebody is turned away; then that goes on record, now and then. `process`: the one that wants
  /// to be served; nothing: it is not known.
  [[nodiscard]] bool turns_away(IdentityRole role, const Principal& who,
                                const std::optional<wire::PeerId>& process);
  /// Tells a client that is turned away why, but only a process that says who it is.
  void bid_farewell(const std::string& name, const wire::TrackerStateMessage& state);
  void open_wanted_feeds(const std::string& name, ClientLink* link);
  /// The serialized blocks of a map, for all who are sent it.
  [[nodiscard]] std::shared_ptr<SerializedBlocks> blocks_of(MapId map);
  /// The publication of a sample; null: it has gone meanwhile, or the sample is not of the client that it
  /// claims to be of.
  template <typename Message>
  [[nodiscard]] const Publications::Publication* identify(Inlet<Message>* inlet,
                                                          const wire::Sample<Message>& sample);
  /// Whether that client is served.
  [[nodiscard]] bool serves(const Publications::Publication& source);
  void refuse_identity(std::string_view topic, const std::string& partition, ClientId claimed);
  void check(const Status& written, const char* what);

  // What the service says.
  [[nodiscard]] Status tell(const std::string& client, const ClientEvent& event) override;
  [[nodiscard]] Status answer(const std::string& operator_name, const wire::AdminReply& reply) override;
  [[nodiscard]] Status write_reply(const std::string& operator_name, const wire::AdminReply& reply);
  void revised(MapId map, const MapSnapshotPtr& newest) override;
  void labelled(const wire::LabelMessage& label) override;
  void label_removed(MapId map, LabelId label) override;
  void ended(MapId map) override;

  using OperatorWriters = std::list<std::pair<std::string, wire::Writer<wire::AdminReply>>>;

  const std::shared_ptr<const Clock> clock_;
  wire::Participant participant_;
  Readers readers_;
  Logger log_;
  SiteAccess& site_;
  Doorkeeper door_;
  std::map<std::string, ClientLink> links_;
  std::map<MapId, std::weak_ptr<SerializedBlocks>> blocks_;  ///< there while somebody is sent the map
  FeedTurns<MapFeed> turns_;
  OperatorWriters operators_;  ///< the one that was answered last in front
  MonotonicTime look_for_gone_at_;
  RateLimit identity_warning_{std::chrono::seconds(1)};
  RateLimit write_trouble_;

  std::mutex mutex_;  ///< of what follows
  std::vector<Task> posted_;
  bool stopping_ = false;

  MapService service_;
  std::thread thread_;
};

}  // namespace cairn
