// SPDX-License-Identifier: Apache-2.0
#include "server/service/switchboard.h"

#include <algorithm>
#include <array>
#include <exception>
#include <utility>

#include "common/base/utf8.h"
#include "common/base/version.h"
#include "common/wire/partition.h"
#include "server/service/admin_reply.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kTick{200};  // ServerStatus at 5 Hz asserts our liveliness (lease 1 s)
constexpr int kTicksPerMapInfo = 5;
constexpr int kTicksPerExpiry = 300;      // a minute
constexpr size_t kMaxHealthBytes = 1000;  // ServerStatus takes a little more
constexpr size_t kMaxFeeds = 16;          // maps per client
constexpr std::chrono::seconds kNoticeInterval{1};
constexpr std::chrono::seconds kFeedRetry{10};

bool is_map_topic(std::string_view topic) {
  const std::array topics = {wire::topic_name<wire::PointPatches>(), wire::topic_name<wire::PointPositions>(),
                             wire::topic_name<wire::KeyframePoses>(), wire::topic_name<wire::MapCommit>(),
                             wire::topic_name<wire::LabelMessage>()};
  return std::find(topics.begin(), topics.end(), topic) != topics.end();
}

}  // namespace

Result<std::unique_ptr<Switchboard>> Switchboard::start(const ServiceOptions& options, Lanes lanes,
                                                        MapPersistence* store, SiteAccess& site,
                                                        std::vector<RestoredMap> restored, Logger log) {
  wire::ParticipantOptions joining = joining_options(options);
  joining.log = log;
  auto participant = wire::Participant::create(joining);
  if (!participant) return tl::unexpected(participant.error());
  auto discovered = wire::DiscoveredReaders::create(*participant);
  if (!discovered) return tl::unexpected(discovered.error());
  auto readers = wire::create_all<wire::Reader<wire::CameraMessage>, wire::Reader<wire::TrackerStateMessage>,
                                  wire::Reader<wire::MapSeed>, wire::Reader<wire::KeyframeOffer>,
                                  wire::Reader<wire::RelocQuery>, wire::Reader<wire::ClientRequest>>(
      *participant, wire::kEveryClient);
  if (!readers) return tl::unexpected(readers.error());
  auto& [cameras, states, seeds, offers, queries, client_requests] = *readers;
  auto requests = wire::Reader<wire::AdminRequest>::create(*participant, wire::kEveryOperator);
  if (!requests) return tl::unexpected(requests.error());
  auto rigs = wire::Reader<wire::RigState>::create(*participant, wire::kEveryRig);
  if (!rigs) return tl::unexpected(rigs.error());
  auto waiter = wire::Waiter::create(*participant);
  if (!waiter) return tl::unexpected(waiter.error());
  if (Status attached = waiter->attach(
          {*discovered, cameras, states, seeds, offers, queries, client_requests, *requests, *rigs});
      !attached) {
    return tl::unexpected(attached.error());
  }
  std::unique_ptr<Switchboard> board(
      new Switchboard(options, lanes, store, site, std::move(*participant),
                      {std::move(*discovered), std::move(cameras), std::move(states), std::move(seeds),
                       std::move(offers), std::move(queries), std::move(client_requests),
                       std::move(*requests), std::move(*rigs), std::move(*waiter)},
                      std::move(log)));
  board->resume(std::move(restored));
  board->thread_ = std::thread([me = board.get()] { me->run(); });
  return board;
}

Switchboard::Switchboard(const ServiceOptions& options, Lanes lanes, MapPersistence* store, SiteAccess& site,
                         wire::Participant participant, Readers readers, Logger log)
    : options_(options),
      lanes_(lanes),
      store_(store),
      site_(site),
      participant_(std::move(participant)),
      readers_(std::move(readers)),
      log_(std::move(log)),
      maps_(options.seed),
      places_(std::make_shared<PlaceDesk>(PlaceDesk::Lanes{lanes.urgent, lanes.questions, lanes.background},
                                          options.relocalization, log_, options.work_times)),
      wearers_(options.wearers),
      next_tick_(steady_clock::now()) {
  watch_for_overlaps();
  site_.run_by({[this](Task task) { store_->run_beside([task = std::move(task)](Store&) { task(); }); },
                [this](Task task) { post(std::move(task)); }});
  if (store_ == nullptr) return;
  overlaps_.restore(store_->overlaps());
  transfers_ = std::make_shared<Transfers>(store_->folder() / "transfer");
  for (const MapId map : store_->deleted_ids()) maps_.reserve(map);
  damaged_ = store_->damaged_files();
}

void Switchboard::watch_for_overlaps() {
  const auto index = [places = std::weak_ptr(places_)] {
    const auto desk = places.lock();
    return desk ? desk->index() : std::make_shared<const PlaceIndex>();
  };
  const auto tell = [this](const Overlap& overlap) { post([this, overlap] { on_overlap(overlap); }); };
  const auto watch = std::make_shared<OverlapWatch>(lanes_.idle, options_.relocalization, index, tell, log_,
                                                    options_.work_times);
  places_->listen({[watch](const auto& map, auto views) { watch->note_searched(map, views); },
                   [watch](const MapId& map) { watch->remove(map); }});
}

void Switchboard::stop() {
  {
    const std::scoped_lock lock(mutex_);
    if (std::exchange(stopping_, true)) return;
    posted_.clear();
  }
  readers_.waiter.wake();
  if (thread_.joinable()) thread_.join();
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.runner) entry.runner->stop();
  }
}

void Switchboard::post(Task task) {
  {
    const std::scoped_lock lock(mutex_);
    if (stopping_) return;
    posted_.push_back(std::move(task));
  }
  readers_.waiter.wake();
}

void Switchboard::publish(MapSnapshotPtr snapshot) {
  post([this, snapshot = std::move(snapshot)] {
    if (maps_.find(snapshot->map) == nullptr)
      maps_.add(snapshot->map, MapEntry{snapshot->name, {}, {}, {}, {}});
    on_map_changed(snapshot->map, {snapshot, {}, {}});
  });
}

std::vector<MapSnapshotPtr> Switchboard::maps() const {
  const std::scoped_lock lock(mutex_);
  std::vector<MapSnapshotPtr> snapshots;
  for (const auto& [map, snapshot] : published_) snapshots.push_back(snapshot);
  return snapshots;
}

void Switchboard::run() {
  while (true) {
    readers_.waiter.wait(time_to_wait());
    {
      const std::scoped_lock lock(mutex_);
      if (stopping_) return;
    }
    try {
      run_posted();
      take_messages();
      take_rigs(steady_clock::now());
      feed_clients();
      const MonotonicTime now = steady_clock::now();
      if (now >= next_tick_) tick(now);
    } catch (const std::exception& problem) {
      log_->error("internal error: {}", problem.what());  // whatever a peer did: the others are served
    }
  }
}

milliseconds Switchboard::time_to_wait() const {
  MonotonicTime next = next_tick_;
  for (const auto& [name, client] : clients_) {
    for (const auto& [map, feed] : client.feeds) {
      if (const auto due = feed.deadline()) next = std::min(next, *due);
    }
  }
  const MonotonicTime now = steady_clock::now();
  return next <= now ? milliseconds(0) : std::chrono::ceil<milliseconds>(next - now);
}

void Switchboard::run_posted() {
  std::vector<Task> tasks;
  {
    const std::scoped_lock lock(mutex_);
    tasks.swap(posted_);
  }
  for (const Task& task : tasks) {
    try {
      task();
    } catch (const std::exception& problem) {
      log_->error("internal error: {}", problem.what());  // the tasks behind it have nothing to do with it
    }
  }
}

void Switchboard::take_messages() {
  for (const wire::DiscoveredReader& reader : readers_.discovered.take()) on_discovered(reader);
  wire::take_all(readers_.cameras, [this](const auto& sample) {
    Client* client = identify(readers_.cameras, sample);
    const auto process = readers_.cameras.peer_of(sample.publication);
    if (client == nullptr || !sample.message || !process) return;
    const Status taken = client->cameras.put(*process, *sample.message);
    if (taken) client->camera_missed_at.reset();
    if (!taken && client->camera_warning.due())
      log_->warn("{}: camera {} refused: {}", client->name, sample.message->camera, taken.error().message);
  });
  wire::take_all(readers_.states, [this](const auto& sample) {
    if (!sample.message) {
      // No tracker disposes; anybody may under any key. That no writer of a key is left, the middleware says.
      if (sample.gone == wire::Gone::kNoWriters) on_gone(sample.key.client);
      return;
    }
    if (Client* client = identify(readers_.states, sample))
      on_state(*client, sample.publication, *sample.message);
  });
  wire::take_all(readers_.seeds, [this](auto& sample) {
    Client* client = identify(readers_.seeds, sample);
    if (client != nullptr && sample.message) on_seed(*client, std::move(*sample.message));
  });
  wire::take_all(readers_.offers, [this](auto& sample) {
    Client* client = identify(readers_.offers, sample);
    if (client != nullptr && sample.message) on_offer(*client, std::move(*sample.message));
  });
  wire::take_all(readers_.queries, [this](auto& sample) {
    Client* client = identify(readers_.queries, sample);
    if (client != nullptr && sample.message) on_query(*client, std::move(*sample.message));
  });
  wire::take_all(readers_.client_requests, [this](const auto& sample) {
    Client* client = identify(readers_.client_requests, sample);
    if (client != nullptr && sample.message) on_request(*client, *sample.message);
  });
  wire::take_all(readers_.requests, [this](const auto& sample) {
    const auto partition = readers_.requests.partition_of(sample.publication);
    const auto name = partition ? wire::parse_operator_partition(*partition) : std::nullopt;
    if (!name || !sample.message) return;
    if (client_id_from_name(*name) != sample.message->operator_id)
      return refuse_identity(wire::topic_name<wire::AdminRequest>(), *partition, sample.message->operator_id);
    on_admin(*name, *sample.message);
  });
}

/// A rig's orders pass the server by; what it says of them is all that there is for the record.
void Switchboard::take_rigs(MonotonicTime now) {
  wire::take_all(readers_.rigs, [&](const auto& sample) {
    const auto partition = readers_.rigs.partition_of(sample.publication);
    if (!sample.message || !partition || *partition != wire::rig_partition(sample.message->rig)) return;
    for (const std::string& line : rigs_.heard(*sample.message, now)) log_->info("{}", line);
  });
}

void Switchboard::feed_clients() {
  const MonotonicTime now = steady_clock::now();
  for (auto& [name, client] : clients_) {
    for (auto& [map, feed] : client.feeds) feed.work(now);
  }
}

std::string Switchboard::health() const {
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

void Switchboard::tick(MonotonicTime now) {
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
    if (!client.writers) continue;
    report(client.writers->status.write(status), "ServerStatus");
    if (std::exchange(client.repeat_verdicts, false)) write_verdicts(client);
  }
  if (++ticks_ % kTicksPerExpiry == 0 && store_ != nullptr) {
    store_->run_beside([transfers = transfers_](Store&) { transfers->expire(steady_clock::now()); });
    look_for_damage();  // an operator may have taken it away
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

void Switchboard::on_discovered(const wire::DiscoveredReader& reader) {
  if (reader.partitions.size() != 1) return;
  const auto identity = wire::parse_partition(reader.partitions.front());
  if (!identity) return;
  Client& client = client_of(identity->client);
  if (identity->map && is_map_topic(reader.topic)) {
    int& readers = client.wanted[*identity->map];
    readers += reader.gone ? -1 : 1;
    if (readers <= 0) {
      client.wanted.erase(*identity->map);
      client.feeds.erase(*identity->map);
    } else {
      open_wanted_feeds(client);
    }
  } else if (!identity->map && reader.topic == wire::topic_name<wire::ServerStatus>()) {
    client.status_readers += reader.gone ? -1 : 1;
    if (client.status_readers == 1 && !reader.gone) connect(client);
    if (client.status_readers == 0 && reader.gone) disconnect(client);
  }
}

Client& Switchboard::client_of(const std::string& name) {
  const auto [it, is_new] = clients_.try_emplace(name);
  if (is_new) {
    it->second.name = name;
    it->second.id = client_id_from_name(name);
    it->second.left_at = steady_clock::now();
    names_[it->second.id] = name;
    forget_old_clients(name);
  }
  return it->second;
}

void Switchboard::forget_old_clients(const std::string& keep) {
  while (clients_.size() > kMaxClients) {
    auto oldest = clients_.end();
    for (auto it = clients_.begin(); it != clients_.end(); ++it) {
      if (!it->second.writers && it->first != keep &&
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

void Switchboard::connect(Client& client) {
  auto writers = ClientWriters::create(participant_, client.name);
  if (!writers) return log_->error("{}: cannot be served: {}", client.name, writers.error().message);
  client.writers = std::move(*writers);
  client.maps_told.clear();
  log_->info("{}: connected", client.name);
  next_tick_ = steady_clock::now();  // the newcomer learns at once who serves it
  write_verdicts(client);
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.snapshot) list_map(map, entry, client);
  }
  client.cameras_told.clear();
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.snapshot) tell_cameras(map, entry);
  }
}

void Switchboard::disconnect(Client& client) {
  log_->info("{}: left", client.name);
  client.writers.reset();
  client.left_at = steady_clock::now();
  presence_.gone(client.name);
  wearers_.left(client.name);
  young_.left(client.name);
}

void Switchboard::open_wanted_feeds(Client& client) {
  for (const auto& [map, readers] : client.wanted) {
    const MapEntry* entry = maps_.find(map);
    if (entry == nullptr || entry->snapshot == nullptr || client.feeds.contains(map)) continue;
    if (!options_.access->may_read(client.principal(), map)) continue;
    const MonotonicTime now = steady_clock::now();
    if (client.feed_failed_at && now - *client.feed_failed_at < kFeedRetry) return;
    client.feed_failed_at = now;
    if (client.feeds.size() >= kMaxFeeds) return log_->warn("{}: wants too many maps at once", client.name);
    auto feed = MapFeed::create(participant_, client.name, map, log_);
    if (!feed)
      return log_->error("{}: map {} cannot be sent: {}", client.name, entry->name, feed.error().message);
    client.feed_failed_at.reset();
    feed->update(entry->snapshot);
    for (Label& label : entry->labels.all())
      report(feed->show({map, entry->snapshot->epoch, std::move(label)}), "Label");
    client.feeds.emplace(map, std::move(*feed));
  }
}

template <typename Message>
Client* Switchboard::identify(const wire::Reader<Message>& reader, const wire::Sample<Message>& sample) {
  const auto partition = reader.partition_of(sample.publication);
  if (!partition) return nullptr;  // the writer has gone meanwhile
  const auto identity = wire::parse_partition(*partition);
  const ClientId claimed = sample.message ? sample.message->client : sample.key.client;
  if (!identity || identity->map || client_id_from_name(identity->client) != claimed) {
    refuse_identity(wire::topic_name<Message>(), *partition, claimed);
    return nullptr;
  }
  return &client_of(identity->client);
}

void Switchboard::refuse_identity(std::string_view topic, const std::string& partition, ClientId claimed) {
  const MonotonicTime now = steady_clock::now();
  if (now - identity_logged_ < kNoticeInterval) return;
  identity_logged_ = now;
  log_->warn("a {} from partition '{}' claims to be of client {}: refused", topic, partition,
             to_hex(claimed.bytes));
}

void Switchboard::on_state(Client& client, wire::PublicationHandle publication,
                           const wire::TrackerStateMessage& message) {
  const MonotonicTime now = steady_clock::now();
  switch (presence_.heard(client.name, message.session, publication, now)) {
    case Presence::Standing::kIntruder:
      return tell_intruder(client, message.session, now);
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
  if (const auto process = readers_.states.peer_of(publication)) client.cameras.set_holder(*process);
  const bool is_proven = message.state == TrackingState::kTracking || message.state == TrackingState::kPoor;
  // A replica outlives its map, and anybody may name one that never was: neither narrows the answers to
  // others.
  const bool is_here = is_proven && maps_.find(message.map) != nullptr &&
                       options_.access->may_read(client.principal(), message.map);
  wearers_.heard(client.name, {message.wearer, is_here ? message.map : MapId{}, message.frame_time}, now);
  young_.heard(client.name, {message.session, message.state, message.map, message.frame_time}, now);
  const auto feed = client.feeds.find(message.map);
  if (feed != client.feeds.end()) feed->second.client_has(message.epoch, message.revision);
}

void Switchboard::on_gone(ClientId id) {
  const auto name = names_.find(id);
  if (name == names_.end()) return;
  log_->debug("{}: its tracker has fallen silent", name->second);
  presence_.gone(name->second);
  wearers_.left(name->second);
}

void Switchboard::tell_intruder(Client& client, SessionId session, MonotonicTime now) {
  if (client.intruder_told_at && now - *client.intruder_told_at < kNoticeInterval) return;
  client.intruder_told_at = now;
  const std::string reason = "another live process is called '" + client.name + "'; choose another --name";
  if (std::exchange(client.intruder, session) != session)
    log_->warn("{}: a second process under this name is refused", client.name);
  if (!client.writers) return;
  report(client.writers->offers.write({client.id, session, 0, 0, {notice_to_process(reason)}}),
         "OfferVerdict");
  client.repeat_verdicts = true;
}

}  // namespace cairn
