// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/log.h"
#include "common/map/map_set.h"
#include "common/wire/discovered_readers.h"
#include "common/wire/participant.h"
#include "common/wire/rig_messages.h"
#include "common/wire/topic.h"
#include "common/wire/waiter.h"
#include "server/service/admin_gate.h"
#include "server/service/client.h"
#include "server/service/map_array.h"
#include "server/service/overlap_list.h"
#include "server/service/overlap_watch.h"
#include "server/service/place_desk.h"
#include "server/service/presence.h"
#include "server/service/rig_list.h"
#include "server/service/service.h"
#include "server/service/site_access.h"
#include "server/service/transfers.h"
#include "server/service/wearer_rule.h"
#include "server/service/worker_pool.h"
#include "server/service/young_maps.h"

namespace cairn {

/// The server's I/O thread and all that belongs to it: readers, clients and their writers, the list of maps.
/// It takes messages, passes seeds and offers to the queues of their maps and writes what these decide.
/// Nothing here is shared: other threads call post().
class Switchboard {
 public:
  struct Lanes {
    WorkerPool& urgent;
    WorkerPool& background;
    WorkerPool& questions;
    WorkerPool& idle;
  };
  /// With all `restored` maps being served on return.
  [[nodiscard]] static Result<std::unique_ptr<Switchboard>> start(const ServiceOptions& options, Lanes lanes,
                                                                  MapPersistence* store, SiteAccess& site,
                                                                  std::vector<RestoredMap> restored,
                                                                  Logger log);
  ~Switchboard() { stop(); }
  Switchboard(const Switchboard&) = delete;
  Switchboard& operator=(const Switchboard&) = delete;

  /// Ends the thread and tells the maps to stop. Running work may call post() until its lane has ended:
  /// outlive the lanes.
  void stop();

  /// Runs `task` on the I/O thread, soon; dropped once that has ended. Thread-safe.
  void post(Task task);
  /// See Service. Thread-safe.
  void publish(MapSnapshotPtr snapshot);
  [[nodiscard]] std::vector<MapSnapshotPtr> maps() const;
  [[nodiscard]] const wire::NetworkPath& network() const { return participant_.path(); }
  /// Hands what has changed in all maps to the store. After stop(), when the lanes have ended.
  void save_last_changes();

 private:
  struct Readers {
    wire::DiscoveredReaders discovered;
    wire::Reader<wire::CameraMessage> cameras;
    wire::Reader<wire::TrackerStateMessage> states;
    wire::Reader<wire::MapSeed> seeds;
    wire::Reader<wire::KeyframeOffer> offers;
    wire::Reader<wire::RelocQuery> queries;
    wire::Reader<wire::ClientRequest> client_requests;
    wire::Reader<wire::AdminRequest> requests;
    wire::Reader<wire::RigState> rigs;
    wire::Waiter waiter;
  };
  Switchboard(const ServiceOptions& options, Lanes lanes, MapPersistence* store, SiteAccess& site,
              wire::Participant participant, Readers readers, Logger log);

  void watch_for_overlaps();

  // The loop (switchboard.cpp).
  void run();
  [[nodiscard]] std::chrono::milliseconds time_to_wait() const;
  void run_posted();
  void take_messages();
  void take_rigs(MonotonicTime now);
  void feed_clients();
  [[nodiscard]] std::string health() const;
  void tick(MonotonicTime now);

  // Who is there (switchboard.cpp).
  void on_discovered(const wire::DiscoveredReader& reader);
  void connect(Client& client);
  void disconnect(Client& client);
  void open_wanted_feeds(Client& client);
  [[nodiscard]] Client& client_of(const std::string& name);
  void forget_old_clients(const std::string& keep);
  void refuse_identity(std::string_view topic, const std::string& partition, ClientId claimed);
  template <typename Message>
  [[nodiscard]] Client* identify(const wire::Reader<Message>& reader, const wire::Sample<Message>& sample);
  void on_state(Client& client, wire::PublicationHandle publication,
                const wire::TrackerStateMessage& message);
  void on_gone(ClientId id);
  void tell_intruder(Client& client, SessionId session, MonotonicTime now);
  /// Whether this server does not serve the client since it works in lockstep; then it is told.
  [[nodiscard]] bool refuses_lockstep(Client& client, bool lockstep);

  // What operators ask (administration.cpp).
  using AdminAnswer = std::function<void(wire::AdminReply reply)>;  ///< to be called on the I/O thread
  void on_admin(const std::string& operator_name, const wire::AdminRequest& message);
  void carry_out(const std::string& operator_name, const wire::AdminRequest& message,
                 const AdminAnswer& answer);
  /// The last answer to this operator, once more.
  void repeat_answer(const std::string& operator_name);
  // About who may do what (site_administration.cpp).
  /// False: the verb is about something else.
  [[nodiscard]] bool administers_access(const std::string& operator_name, const std::string& verb,
                                        const nlohmann::json& request, const AdminAnswer& answer);
  [[nodiscard]] std::optional<NamedMap> named_map(const std::string& name_or_id);
  [[nodiscard]] nlohmann::json describe_clients() const;
  void enforce_rights();
  void unlist_map(MapId map, Client& client);
  /// The answer is told, and what the operator did, or tried to, is written down.
  [[nodiscard]] AdminAnswer audited(const std::string& operator_name, const nlohmann::json& request,
                                    const AdminAnswer& tell);

  [[nodiscard]] std::pair<MapId, MapEntry*> find_map(const std::string& name_or_id);
  void describe_server(const AdminAnswer& answer);
  /// Where a page of maps begins: beyond an id, and at numbers of the lists behind them.
  struct PageBegin {
    std::string after;
    size_t deleted_from = 0;
    size_t damaged_from = 0;
    size_t unloaded_from = 0;
  };
  void list_maps(const PageBegin& begin, const AdminAnswer& answer);
  /// Beside the writer: what has been set aside, and what could not be loaded.
  void look_for_damage();
  void show_map(MapId id, const MapEntry& entry, const AdminAnswer& answer);
  /// What operators are told of a map that is served.
  [[nodiscard]] nlohmann::json describe_map(MapId id, const MapEntry& entry) const;
  /// Renames or removes one (`wish`: action, map, label, text).
  void edit_label(const MapEntry& entry, const wire::ClientRequest& wish, const std::string& operator_name,
                  const AdminAnswer& answer);

  // Of these, the ones that change maps (map_administration.cpp).
  /// `work` is run beside the writer and gives what is then to be done on this thread. If it throws, that is
  /// the answer; without a store as well.
  void with_store(const AdminAnswer& answer, std::function<Task(Store& store)> work);
  void rename_map(MapId id, MapEntry* entry, const std::string& name, const AdminAnswer& answer);
  void delete_map(MapId id, MapEntry* entry, bool for_good, const AdminAnswer& answer);
  /// `removed`: whether the store has let go of it; if not, it stays in service.
  void finish_deletion(MapId id, const Status& removed, const AdminAnswer& answer);
  /// Deletes what nobody will miss (YoungMaps), as an operator would.
  void drop_dead_maps(MonotonicTime now);
  /// To a request about a map that is not in service: one that is deleted is told from one that nobody knows.
  void answer_without_map(const std::string& verb, const std::string& wanted, const AdminAnswer& answer);
  void undelete_map(const std::string& wanted, const AdminAnswer& answer);
  void purge_map(const std::string& wanted, const AdminAnswer& answer);
  /// Beside the writer: a map that has just come (back) into the store; `undo` takes it out again if it
  /// cannot be served, or not be called as it must.
  void take_in(MapId id, MapPersistence::Undo undo, const AdminAnswer& answer);
  void export_map(MapId id, const MapEntry* entry, const AdminAnswer& answer);
  void transfer(const std::string& verb, const std::string& token, uint64_t offset, std::vector<uint8_t> data,
                const AdminAnswer& answer);
  void import_map(const std::string& token, const AdminAnswer& answer);

  // Maps and clients from before a restart (resumption.cpp).
  /// Before the thread begins.
  void resume(std::vector<RestoredMap> restored);
  struct ResumedMap {
    MapHeader header;
    bool plane_aligned = false;
    std::vector<LabelRecord> labels;
    std::shared_ptr<MapRunner> runner;
    MapRevision first;
  };
  /// The part that takes time: by any thread.
  [[nodiscard]] ResumedMap prepare(RestoredMap restored);
  void take_up(ResumedMap map);
  /// take_up() of one that comes in while others are served, under a name that is free; the answer follows
  /// when that is kept.
  void serve_anew(ResumedMap map, MapPersistence::Undo undo, const AdminAnswer& answer);
  void resume_clients(const std::vector<RestoredMap>& restored);
  /// Those that have not been in use for long.
  void let_maps_rest(MonotonicTime now);
  void keep_overlaps();

  // What they want (commands.cpp).
  void on_seed(Client& client, wire::MapSeed message);
  void on_seed_decided(const std::string& client, wire::SeedVerdict verdict, const Result<SeedResult>& result,
                       const MapSnapshotPtr& snapshot);
  void on_offer(Client& client, wire::KeyframeOffer message);
  void on_offer_decided(const std::string& client, SessionId session, wire::OfferOutcome outcome);
  void on_query(Client& client, wire::RelocQuery message);
  /// A camera that is announced as a guess may be known by a map: the values to look for a place with.
  [[nodiscard]] CameraPtr best_known(const Client& client, uint32_t camera,
                                     const AnnouncedCamera& announced) const;
  /// On a worker of the questions.
  void look_up(const std::string& client, const CameraPtr& camera, wire::RelocQuery message,
               const WearerRule::Search& search);
  void on_query_answered(const std::string& client, wire::CommandId command, const PlaceAnswer& answer);
  // Labels (requests.cpp).
  void on_request(Client& client, const wire::ClientRequest& request);
  void on_request_decided(const std::string& client, const wire::ClientRequest& request,
                          const LabelBook::Judgement& judgement);
  /// Somebody wants a label added, renamed or removed; `done` is called on this thread, when it is durable or
  /// refused. The label must not be busy. `decision`: kept along with it.
  using LabelDone = std::function<void(const LabelBook::Judgement& judgement)>;
  void change_label(const wire::ClientRequest& request, const Principal& author,
                    std::optional<DecisionRecord> decision, const LabelDone& done);
  [[nodiscard]] Ruling ruling_on_labels(const Principal& author, MapId map) const;
  void tell_label(MapId map, const MapEntry& entry, LabelId label);
  void move_labels(MapId map, MapEntry& entry);

  [[nodiscard]] std::shared_ptr<MapRunner> make_runner(MapId map);
  void on_map_changed(MapId map, MapRevision revision);
  void on_overlap(const Overlap& overlap);
  /// The map has been deleted, or was never made: nobody is told of it any more.
  void forget_map(MapId map);
  /// Why no map may grow, and first take so much memory `more`; empty when it may.
  [[nodiscard]] std::string why_memory_is_full(size_t more = 0) const;
  /// Why there may be no more maps; empty when there may.
  [[nodiscard]] std::string why_full() const;
  void write_verdicts(Client& client);
  /// Tells those that may read it.
  void list_map(MapId map, const MapEntry& entry);
  void list_map(MapId map, const MapEntry& entry, Client& client);
  /// The maps in which a client may find itself.
  [[nodiscard]] MapSet readable(const Client& client) const;
  void tell_cameras(MapId map, const MapEntry& entry);
  void tell_camera(std::pair<MapId, Epoch> where, const CameraEstimate& estimate, Client& client);
  void forget_cameras(MapId map, Client& client);
  void report(const Status& written, const char* what);

  const ServiceOptions options_;
  Lanes lanes_;
  MapPersistence* store_;
  SiteAccess& site_;
  wire::Participant participant_;
  Readers readers_;
  Logger log_;

  MapArray maps_;
  std::shared_ptr<PlaceDesk> places_;
  OverlapList overlaps_;
  MonotonicTime overlaps_wait_until_ = {};  ///< before, they are not written: the disk would not have them
  std::map<std::string, Client> clients_;
  std::map<ClientId, std::string> names_;
  Presence presence_;
  WearerRule wearers_;
  RigList rigs_;
  YoungMaps young_;
  AdminGate admin_gate_;
  std::map<std::string, wire::Writer<wire::AdminReply>> operators_;  ///< those that the gate knows
  std::shared_ptr<Transfers> transfers_;  ///< used beside the store's writer only; null without a store
  std::map<MapId, bool> info_due_;        ///< maps whose MapInfo has changed since it was told
  std::vector<DamagedFile> damaged_;      ///< as they were when last looked for
  std::vector<UnloadedMap> unloaded_;     ///< likewise
  bool memory_freed_ = false;             ///< by a map that rests, since memory was last given back
  MonotonicTime next_tick_;
  MonotonicTime identity_logged_;
  int ticks_ = 0;

  mutable std::mutex mutex_;  ///< of what follows
  std::vector<Task> posted_;
  std::map<MapId, MapSnapshotPtr> published_;
  bool stopping_ = false;

  std::thread thread_;
};

}  // namespace cairn
