// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_service.h"

#include <algorithm>
#include <utility>

#include "common/base/utf8.h"
#include "common/base/version.h"
#include "server/service/admin_reply.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kTick{200};  // ServerStatus at 5 Hz asserts our liveliness (lease 1 s)
constexpr int kTicksPerMapInfo = 5;
constexpr int kTicksPerExpiry = 300;      // a minute
constexpr size_t kMaxHealthBytes = 1000;  // ServerStatus takes a little more
constexpr std::chrono::seconds kNoticeInterval{1};

}  // namespace

MapService::MapService(const MapServiceOptions& options, Lanes lanes, MapPersistence* store, SiteAccess& site,
                       ServiceOutput& output, Post post, Logger log)
    : options_(options),
      clock_(*options_.clock),
      lanes_(lanes),
      store_(store),
      site_(site),
      output_(output),
      post_(std::move(post)),
      log_(std::move(log)),
      maps_(options.seed, options.entropy),
      places_(std::make_shared<PlaceDesk>(PlaceDesk::Lanes{lanes.urgent, lanes.questions, lanes.background},
                                          options.relocalization, options.clock, log_, options.work_times)),
      wearers_(options.wearers),
      proposals_(options.proposals),
      next_tick_(clock_.now()) {
  watch_for_overlaps();
  site_.run_by({[this](Task task) { store_->run_beside([task = std::move(task)](Store&) { task(); }); },
                [this](Task task) { post_(std::move(task)); }});
  if (store_ == nullptr) return;
  overlaps_.restore(store_->overlaps());
  transfers_ = std::make_shared<Transfers>(store_->folder() / "transfer");
  for (const MapId map : store_->deleted_ids()) maps_.reserve(map);
  damaged_ = store_->damaged_files();
}

void MapService::watch_for_overlaps() {
  const auto index = [places = std::weak_ptr(places_)] {
    const auto desk = places.lock();
    return desk ? desk->index() : std::make_shared<const PlaceIndex>();
  };
  const auto tell = [this](const Overlap& overlap) { post_([this, overlap] { on_overlap(overlap); }); };
  const auto watch = std::make_shared<OverlapWatch>(lanes_.idle, options_.relocalization, index, tell, log_,
                                                    options_.work_times);
  places_->listen({[watch](const auto& map, auto views) { watch->note_searched(map, views); },
                   [watch](const MapId& map) { watch->remove(map); }});
}

void MapService::stop() {
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.runner) entry.runner->stop();
  }
}

void MapService::publish(MapSnapshotPtr snapshot) {
  if (maps_.find(snapshot->map) == nullptr)
    maps_.add(snapshot->map, MapEntry{snapshot->name, {}, {}, {}, {}});
  on_map_changed(snapshot->map, {snapshot, {}, {}});
}

std::vector<MapSnapshotPtr> MapService::maps() const {
  const std::scoped_lock lock(mutex_);
  std::vector<MapSnapshotPtr> snapshots;
  for (const auto& [map, snapshot] : published_) snapshots.push_back(snapshot);
  return snapshots;
}

std::string MapService::health() const {
  std::string words = store_ ? store_->trouble() : std::string();
  const auto add = [&words](const std::string& word) {
    if (!words.empty() && !word.empty()) words += "; ";
    words += word;
  };
  add(site_.trouble());
  add(word_of_unloaded(unloaded_));
  if (store_) add(word_of_damage(damaged_.size(), store_->folder() / "damaged"));
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.frozen.empty()) continue;
    add(entry.name + " is frozen until the server starts again: " + entry.frozen);
    break;  // one is enough to have a look; `cairnctl maps` names all
  }
  return words.empty() ? "ok" : std::string(cut_text(one_line(words), kMaxHealthBytes));
}

void MapService::tick(MonotonicTime now) {
  next_tick_ = now + kTick;
  if (site_.has_expired()) enforce_rights();
  const wire::ServerStatus status{options_.server,
                                  options_.start_count,
                                  std::string(version()),
                                  health(),
                                  static_cast<uint32_t>(presence_.live_count(now)),
                                  static_cast<uint32_t>(maps_.live_count()),
                                  lanes_.urgent.take_load()};
  for (auto& [name, client] : clients_) {
    if (!client.connected) continue;
    tell(client, status);
    if (std::exchange(client.repeat_verdicts, false)) write_verdicts(client);
  }
  if (++ticks_ % kTicksPerExpiry == 0 && store_ != nullptr) {
    store_->run_beside(
        [transfers = transfers_, clock = options_.clock](Store&) { transfers->expire(clock->now()); });
    look_for_damage();  // an operator may have taken it away
    drop_old_proposals();
    purge_old_maps();
  }
  if (ticks_ % kTicksPerMapInfo != 0) return;
  for (const std::string& line : rigs_.pass(now)) log_->info("{}", line);
  let_maps_rest(now);
  drop_dead_maps(now);
  keep_overlaps();
  // Revisions that name what could not be written are waited for in vain, and an idle map makes no more.
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.snapshot) tell_cameras(map, entry);
  }
  for (const auto& [map, due] : std::exchange(info_due_, {})) {
    if (const MapEntry* entry = maps_.find(map)) list_map(map, *entry);
  }
}

Client& MapService::client_of(const Principal& who) {
  const std::string& name = who.name;
  const auto [it, is_new] = clients_.try_emplace(name, options_.rates);
  if (is_new) {
    it->second.name = name;
    it->second.id = client_id_from_name(name);
    it->second.left_at = clock_.now();
    names_[it->second.id] = name;
    forget_old_clients(name);
  }
  it->second.proof = who.proof;
  return it->second;
}

void MapService::forget_old_clients(const std::string& keep) {
  while (clients_.size() > kMaxClients) {
    auto oldest = clients_.end();
    for (auto it = clients_.begin(); it != clients_.end(); ++it) {
      if (!it->second.connected && it->first != keep &&
          (oldest == clients_.end() || it->second.left_at < oldest->second.left_at))
        oldest = it;
    }
    if (oldest == clients_.end()) return;
    presence_.gone(oldest->first);
    wearers_.left(oldest->first);
    names_.erase(oldest->second.id);
    clients_.erase(oldest);
  }
}

void MapService::connect(const Principal& who) {
  Client& client = client_of(who);
  client.connected = true;
  client.maps_told.clear();
  log_->info("{}: connected", client.name);
  next_tick_ = clock_.now();  // the newcomer learns at once who serves it
  write_verdicts(client);
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.snapshot) list_map(map, entry, client);
  }
  client.cameras_told.clear();
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.snapshot) tell_cameras(map, entry);
  }
}

void MapService::disconnect(const Principal& who) {
  Client& client = client_of(who);
  log_->info("{}: left", client.name);
  client.connected = false;
  client.left_at = clock_.now();
  presence_.gone(client.name);
  wearers_.left(client.name);
  young_.left(client.name);
}

std::optional<FollowedMap> MapService::follow(const Principal& who, MapId map) const {
  const auto found = maps_.all().find(map);
  if (found == maps_.all().end() || found->second.snapshot == nullptr) return std::nullopt;
  if (!options_.access->may_read(who, map)) return std::nullopt;
  FollowedMap followed{found->second.snapshot, {}};
  for (Label& label : found->second.labels.all())
    followed.labels.push_back({map, followed.newest->epoch, std::move(label)});
  return followed;
}

void MapService::take(const Principal& who, wire::PeerId process, const wire::CameraMessage& camera) {
  Client& client = client_of(who);
  const MonotonicTime now = clock_.now();
  ClientRates& rates = client.cameras.is_holder(process) ? client.rates : client.others_rates;
  const Status taken = rates.judge(ClientRates::Kind::kCamera, now) == ClientRates::Judgement::kTake
                           ? client.cameras.put(process, camera)
                           : fail(ErrorCode::kRefused, rates.why(ClientRates::Kind::kCamera));
  if (taken) client.camera_missed_at.reset();
  if (!taken && client.camera_warning.due(now))
    log_->warn("{}: camera {} refused: {}", client.name, camera.camera, taken.error().message);
}

void MapService::take(const wire::RigState& rig) {
  for (const std::string& line : rigs_.heard(rig, clock_.now())) log_->info("{}", line);
}

bool MapService::take(const Principal& who, wire::PublicationHandle publication,
                      std::optional<wire::PeerId> process, const wire::TrackerStateMessage& message) {
  Client& client = client_of(who);
  const MonotonicTime now = clock_.now();
  ClientRates& rates = presence_.is_holder(client.name, publication) ? client.rates : client.others_rates;
  if (rates.judge(ClientRates::Kind::kState, now) != ClientRates::Judgement::kTake) return false;
  if (client.kicked == message.session) {
    tell_kicked(client);
    return false;
  }
  switch (presence_.heard(client.name, message.session, publication, now)) {
    case Presence::Standing::kIntruder:
      tell_intruder(client, message.session, now);
      return false;
    case Presence::Standing::kNewHolder:
      client.offer_gate.enter_session(message.session);
      client.seed_gate.enter_session(message.session);
      client.request_gate.enter_session(message.session);
      client.camera_missed_at.reset();
      client.lockstep_refused = false;
      write_verdicts(client);
      break;
    case Presence::Standing::kHolder:
      break;
  }
  if (process) client.cameras.set_holder(*process);
  const bool is_proven = message.state == TrackingState::kTracking || message.state == TrackingState::kPoor;
  // A replica outlives its map, and anybody may name one that never was: neither narrows the answers to
  // others.
  const bool is_here = is_proven && maps_.find(message.map) != nullptr &&
                       options_.access->may_read(client.principal(), message.map);
  client.last_word = {message.session, message.state, message.map, message.quality, is_here, now};
  if (is_here) maps_.find(message.map)->localized_at = clock_.wall();
  wearers_.heard(client.name, {message.wearer, is_here ? message.map : MapId{}, message.frame_time}, now);
  young_.heard(client.name, {message.session, message.state, message.map, message.frame_time}, now);
  return true;
}

void MapService::fell_silent(ClientId id) {
  const auto name = names_.find(id);
  if (name == names_.end()) return;
  log_->debug("{}: its tracker has fallen silent", name->second);
  presence_.gone(name->second);
  wearers_.left(name->second);
}

void MapService::tell_intruder(Client& client, SessionId session, MonotonicTime now) {
  if (client.intruder_told_at && now - *client.intruder_told_at < kNoticeInterval) return;
  client.intruder_told_at = now;
  const std::string reason = "another live process is called '" + client.name + "'; choose another --name";
  if (std::exchange(client.intruder, session) != session)
    log_->warn("{}: a second process under this name is refused", client.name);
  if (!client.connected) return;
  tell(client, wire::OfferVerdict{client.id, session, 0, 0, {notice_to_process(reason)}});
  client.repeat_verdicts = true;
}

}  // namespace cairn
