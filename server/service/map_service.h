// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/base/log.h"
#include "common/base/rate_limit.h"
#include "common/map/map_set.h"
#include "common/wire/messages.h"
#include "common/wire/peers.h"
#include "common/wire/rig_messages.h"
#include "server/access/principal.h"
#include "server/service/admin_gate.h"
#include "server/service/client.h"
#include "server/service/map_array.h"
#include "server/service/overlap_list.h"
#include "server/service/overlap_watch.h"
#include "server/service/place_desk.h"
#include "server/service/presence.h"
#include "server/service/proposal_book.h"
#include "server/service/proposal_judge.h"
#include "server/service/rig_list.h"
#include "server/service/service_options.h"
#include "server/service/service_output.h"
#include "server/service/site_access.h"
#include "server/service/transfers.h"
#include "server/service/wearer_rule.h"
#include "server/service/young_maps.h"

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
  struct Lanes {
    Executor& urgent;
    Executor& background;
    Executor& questions;
    Executor& idle;
  };
  /// Runs a task on the service's thread, soon; thread-safe.
  using Post = std::function<void(Task task)>;
  /// The lanes, `store` (null: nothing is kept), `site`, `output` and what `post` needs outlive the service.
  MapService(const MapServiceOptions& options, Lanes lanes, MapPersistence* store, SiteAccess& site,
             ServiceOutput& output, Post post, Logger log);
  MapService(const MapService&) = delete;
  MapService& operator=(const MapService&) = delete;

  /// Serves all `restored` maps. Before anything else.
  void resume(std::vector<RestoredMap> restored);
  /// Tells the maps to stop: running work ends soon.
  void stop();
  /// Hands what has changed in all maps to the store. After stop(), when the lanes have ended.
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
  /// Commands and questions, of the process that holds the name; of others they are passed over.
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
  /// A map that the store has given back.
  struct ResumedMap {
    MapHeader header;
    bool plane_aligned = false;
    std::vector<LabelRecord> labels;
    LabelId last_label;
    std::vector<ProposalSummary> proposals;
    uint64_t last_proposal = 0;
    std::vector<EpochRecord> epochs;
    std::string maker;
    std::shared_ptr<MapRunner> runner;
    MapRevision first;
  };

  void watch_for_overlaps();

  [[nodiscard]] std::string health() const;

  // Who is there (map_service.cpp).
  [[nodiscard]] Client& client_of(const Principal& who);
  void forget_old_clients(const std::string& keep);
  void tell_intruder(Client& client, SessionId session, MonotonicTime now);
  /// Whether this server does not serve the client since it works in lockstep; then it is told.
  [[nodiscard]] bool refuses_lockstep(Client& client, bool lockstep);

  // What operators ask (administration.cpp).
  using AdminAnswer = std::function<void(wire::AdminReply reply)>;  ///< to be called on the I/O thread
  class Ticket;
  void refuse_for_now(const std::string& operator_name, wire::CommandId command, const std::string& why);
  void carry_out(const Principal& who, const wire::AdminRequest& message, const AdminAnswer& answer);
  /// The last answer to this operator, once more.
  void repeat_answer(const std::string& operator_name, wire::CommandId command);
  // About who may do what (site_administration.cpp).
  /// False: the verb is about something else.
  [[nodiscard]] bool administers_access(const std::string& operator_name, const std::string& verb,
                                        const nlohmann::json& request, const AdminAnswer& answer);
  [[nodiscard]] std::optional<NamedMap> named_map(const std::string& name_or_id);
  [[nodiscard]] nlohmann::json describe_clients() const;
  [[nodiscard]] bool is_fresh(const Client::Word& word) const;
  /// How many trackers are found in a map now.
  [[nodiscard]] size_t count_in(MapId map) const;
  [[nodiscard]] Result<nlohmann::json> kick_client(const std::string& name);
  void tell_kicked(Client& client);
  void enforce_rights();
  void unlist_map(MapId map, Client& client);
  /// The answer is told, and what the operator did, or tried to, is written down.
  [[nodiscard]] AdminAnswer audited(const std::string& operator_name, const std::string& verb,
                                    const nlohmann::json& request, const AdminAnswer& tell);

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
  void edit_label(const MapEntry& entry, const wire::ClientRequest& wish, const Principal& who,
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
  /// What was deleted long ago.
  void purge_old_maps();
  /// Beside the writer: a map that has just come (back) into the store; `undo` takes it out again if it
  /// cannot be served, or not be called as it must.
  void take_in(MapId id, MapPersistence::Undo undo, const AdminAnswer& answer);
  void export_map(MapId id, const MapEntry* entry, const AdminAnswer& answer);
  // Backup and verification, file by file (store_administration.cpp).
  /// False: the verb is about something else.
  [[nodiscard]] bool looks_after_store(const std::string& operator_name, const nlohmann::json& request,
                                       const AdminAnswer& answer);
  void list_parts(const std::string& after, const AdminAnswer& answer);
  void back_up_part(const std::string& part, const AdminAnswer& answer);
  void verify_part(const std::string& part, const AdminAnswer& answer);
  // Versions (map_versions.cpp).
  /// False: the verb is about something else.
  [[nodiscard]] bool keeps_versions(const std::string& operator_name, MapId id, MapEntry* entry,
                                    const nlohmann::json& request, const AdminAnswer& answer);
  void tag_map(MapId id, const MapEntry& entry, MapTag tag, const AdminAnswer& answer);
  void list_tags(MapId id, uint64_t after, const AdminAnswer& answer);
  void list_contributors(MapId id, const MapEntry& entry, const std::string& after,
                         const AdminAnswer& answer);
  void roll_back_map(MapId id, const std::string& name, MapTag before, const AdminAnswer& answer);
  /// Why there is no room for what was tagged; empty where there is.
  [[nodiscard]] std::string why_tag_is_too_large(const MapEntry& entry, const MapTag& tag) const;
  /// The map is served from another state of its file in a new epoch, or nothing has happened.
  using ChangeOfState = std::function<Status(Store& store, const AcceptState& accept)>;
  void change_state(MapId id, ChangeOfState change, const AdminAnswer& answer);
  void change_state_in_place(MapId id, MapEntry* entry, ChangeOfState change, HeldLane::Hold place,
                             const AdminAnswer& answer);
  void drop_contributor_of(MapId id, const MapSnapshotPtr& map, const std::string& client,
                           const AdminAnswer& answer);
  void replace_map(ResumedMap map, const AdminAnswer& answer);
  void copy_map(MapId id, const MapEntry& entry, const std::string& name, const AdminAnswer& answer);
  void transfer(const std::string& verb, const std::string& token, uint64_t offset, std::vector<uint8_t> data,
                const AdminAnswer& answer);
  void import_map(const std::string& token, const AdminAnswer& answer);

  // Maps and clients from before a restart (resumption.cpp).
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

  // Keyframes kept aside (proposals.cpp).
  static constexpr const char* kNoProposals = "no proposals are taken in this map";
  [[nodiscard]] bool takes_proposals(const Client& client, MapId map, const MapEntry& entry) const;
  /// Why an offer can be a proposal at most; empty: the map maker is to judge it.
  [[nodiscard]] std::string why_aside(const wire::KeyframeOffer& offer, const MapEntry& entry,
                                      const Ruling& ruling) const;
  void propose(Client* client, const MapEntry& entry, wire::KeyframeOffer offer,
               const AnnouncedCamera& camera, std::string why);
  using Pending = std::shared_ptr<const PendingOffer>;
  void on_proposal_judged(SessionId session, wire::OfferOutcome outcome, ProposalJudgement judged,
                          const Pending& pending);
  void keep_proposal(SessionId session, wire::OfferOutcome outcome, KeptProposal kept,
                     const Pending& pending);
  void drop_old_proposals();
  /// The map is not being rolled back.
  void remove_proposals(MapId map, const std::vector<uint64_t>& numbers);
  struct NamedProposal {
    MapId map;
    uint64_t number = 0;
  };
  [[nodiscard]] std::optional<NamedProposal> named_proposal(const std::string& id) const;
  /// False: the verb is about something else.
  [[nodiscard]] bool decides_proposals(const nlohmann::json& request, const AdminAnswer& answer);
  void list_proposals(const nlohmann::json& request, const AdminAnswer& answer);
  /// If it can be read, `use` is called on this thread; if not, that is the answer.
  void read_proposal(const NamedProposal& which, const AdminAnswer& answer,
                     std::function<void(KeptProposal kept)> use);
  void show_proposal(const NamedProposal& which, const AdminAnswer& answer);
  void send_picture(const NamedProposal& which, uint64_t offset, const AdminAnswer& answer);
  void drop_proposal(const NamedProposal& which, const AdminAnswer& answer);
  [[nodiscard]] std::string why_not_accepted(MapId map, const MapEntry& entry) const;
  void accept_proposal(const NamedProposal& which, const AdminAnswer& answer);
  /// `is_final`: what was refused as stale would be so again.
  void on_proposal_decided(const NamedProposal& which, const std::string& client,
                           const OfferJudgement& judgement, bool is_final, const AdminAnswer& answer);

  // What they want (commands.cpp).
  void on_seed_decided(const std::string& client, wire::SeedVerdict verdict, const Result<SeedResult>& result,
                       const MapSnapshotPtr& snapshot);
  void take_out(MapId map);
  void on_offer_decided(const std::string& client, SessionId session, wire::OfferOutcome outcome);
  /// A camera that is announced as a guess may be known by a map: the values to look for a place with.
  [[nodiscard]] CameraPtr best_known(const Client& client, uint32_t camera,
                                     const AnnouncedCamera& announced) const;
  /// On a worker of the questions.
  void look_up(const std::string& client, const CameraPtr& camera, wire::RelocQuery message,
               const WearerRule::Search& search);
  void on_query_answered(const std::string& client, wire::CommandId command, const PlaceAnswer& answer);
  // Labels (requests.cpp).
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
  /// Why the map may not grow; empty when it may.
  [[nodiscard]] std::string why_map_is_full(const MapEntry& entry) const;
  /// Why there may be no more maps; empty when there may.
  [[nodiscard]] std::string why_full() const;
  /// Why a client may make no more maps; empty when it may.
  [[nodiscard]] std::string why_maker_is_full(const Client& client) const;
  void write_verdicts(Client& client);
  /// Tells those that may read it.
  void list_map(MapId map, const MapEntry& entry);
  void list_map(MapId map, const MapEntry& entry, Client& client);
  /// The maps in which a client may find itself.
  [[nodiscard]] MapSet readable(const Client& client) const;
  void tell_cameras(MapId map, const MapEntry& entry);
  void tell_camera(std::pair<MapId, Epoch> where, const CameraEstimate& estimate, Client& client);
  void forget_cameras(MapId map, Client& client);
  /// If it is connected.
  Status tell(const Client& client, const ClientEvent& event);

  const MapServiceOptions options_;
  const Clock& clock_;
  Lanes lanes_;
  MapPersistence* store_;
  SiteAccess& site_;
  ServiceOutput& output_;
  const Post post_;
  Logger log_;

  MapArray maps_;
  std::shared_ptr<PlaceDesk> places_;
  OverlapList overlaps_;
  MonotonicTime overlaps_wait_until_ = {};  ///< before, they are not written: the disk would not have them
  std::map<std::string, Client> clients_;
  std::map<ClientId, std::string> names_;
  Presence presence_;
  const WaitingBytes waiting_bytes_ = std::make_shared<std::atomic<size_t>>(0);
  WearerRule wearers_;
  RigList rigs_;
  YoungMaps young_;
  ProposalBook proposals_;
  size_t proposals_in_work_ = 0;  ///< being looked at
  AdminGate admin_gate_;
  std::set<std::string> backing_up_;      ///< operators who have begun a backup, which is on record
  std::shared_ptr<Transfers> transfers_;  ///< used beside the store's writer only; null without a store
  std::map<MapId, bool> info_due_;        ///< maps whose MapInfo has changed since it was told
  std::vector<DamagedFile> damaged_;      ///< as they were when last looked for
  std::vector<UnloadedMap> unloaded_;     ///< likewise
  bool memory_freed_ = false;             ///< by a map that rests, since memory was last given back
  MonotonicTime next_tick_;
  RateLimit output_trouble_;
  int ticks_ = 0;

  mutable std::mutex mutex_;  ///< of what follows
  std::map<MapId, MapSnapshotPtr> published_;
};

}  // namespace cairn
