// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/endpoint.h"

#include <pthread.h>

#include <algorithm>
#include <array>
#include <exception>
#include <utility>

#include "common/wire/partition.h"
#include "server/endpoint/newest_queries.h"
#include "server/service/admin_reply.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr size_t kMaxFeeds = 16;  // maps per client
constexpr std::chrono::seconds kFeedRetry{10};
constexpr std::chrono::seconds kLookForGone{60};  // publications

bool is_map_topic(std::string_view topic) {
  const std::array topics = {wire::topic_name<wire::PointPatches>(), wire::topic_name<wire::PointPositions>(),
                             wire::topic_name<wire::KeyframePoses>(), wire::topic_name<wire::MapCommit>(),
                             wire::topic_name<wire::LabelMessage>()};
  return std::find(topics.begin(), topics.end(), topic) != topics.end();
}

}  // namespace

Result<Endpoint::Readers> Endpoint::make_readers(const wire::Participant& participant) {
  auto discovered = wire::DiscoveredReaders::create(participant);
  if (!discovered) return tl::unexpected(discovered.error());
  auto participants = wire::DiscoveredParticipants::create(participant);
  if (!participants) return tl::unexpected(participants.error());
  auto readers = wire::create_all<wire::Reader<wire::CameraMessage>, wire::Reader<wire::TrackerStateMessage>,
                                  wire::Reader<wire::MapSeed>, wire::Reader<wire::KeyframeOffer>,
                                  wire::Reader<wire::RelocQuery>, wire::Reader<wire::ClientRequest>>(
      participant, wire::kEveryClient);
  if (!readers) return tl::unexpected(readers.error());
  auto& [cameras, states, seeds, offers, queries, client_requests] = *readers;
  auto requests = wire::Reader<wire::AdminRequest>::create(participant, wire::kEveryOperator);
  if (!requests) return tl::unexpected(requests.error());
  auto rigs = wire::Reader<wire::RigState>::create(participant, wire::kEveryRig);
  if (!rigs) return tl::unexpected(rigs.error());
  auto waiter = wire::Waiter::create(participant);
  if (!waiter) return tl::unexpected(waiter.error());
  if (Status attached = waiter->attach({*discovered, *participants, cameras, states, seeds, offers, queries,
                                        client_requests, *requests, *rigs});
      !attached) {
    return tl::unexpected(attached.error());
  }
  return Readers{
      std::move(*discovered), std::move(*participants), {std::move(cameras)}, {std::move(states)},
      {std::move(seeds)},     {std::move(offers)},      {std::move(queries)}, {std::move(client_requests)},
      {std::move(*requests)}, {std::move(*rigs)},       std::move(*waiter)};
}

Result<std::unique_ptr<Endpoint>> Endpoint::start(const ServiceOptions& options,
                                                  MapService::Executors executors, MapPersistence* store,
                                                  SiteAccess& site, SiteKeys keys,
                                                  std::vector<RestoredMap> restored, Logger log) {
  wire::ParticipantOptions joining = joining_options(options);
  joining.log = log;
  auto participant = wire::Participant::create(joining);
  if (!participant) return tl::unexpected(participant.error());
  auto readers = make_readers(*participant);
  if (!readers) return tl::unexpected(readers.error());
  std::unique_ptr<Endpoint> endpoint(new Endpoint(options, executors, store, site, std::move(keys),
                                                  std::move(*participant), std::move(*readers),
                                                  std::move(log)));
  endpoint->service_.resume(std::move(restored));
  endpoint->look_who_is_turned_away();
  endpoint->thread_ = std::thread([me = endpoint.get()] { me->run(); });
  pthread_setname_np(endpoint->thread_.native_handle(), "cairn-io");  // for who looks what takes the time
  return endpoint;
}

Endpoint::Endpoint(const ServiceOptions& options, MapService::Executors executors, MapPersistence* store,
                   SiteAccess& site, SiteKeys keys, wire::Participant participant, Readers readers,
                   Logger log)
    : clock_(options.clock),
      participant_(std::move(participant)),
      readers_(std::move(readers)),
      log_(log),
      site_(site),
      door_(std::move(keys), log, options.refused),
      look_for_gone_at_(clock_->now() + kLookForGone),
      service_(
          options, executors, store, site, *this, [this](Task task) { post(std::move(task)); },
          std::move(log)) {
  site_.know_clients(door_.groups_of_clients());
}

void Endpoint::stop() {
  std::vector<Task> dropped;  // outside of the lock: what they hold may post
  {
    const std::scoped_lock lock(mutex_);
    if (std::exchange(stopping_, true)) return;
    dropped.swap(posted_);
  }
  readers_.waiter.wake();
  if (thread_.joinable()) thread_.join();
  service_.stop();
}

void Endpoint::post(Task task) {
  {
    const std::scoped_lock lock(mutex_);
    if (stopping_) return;
    posted_.push_back(std::move(task));
  }
  readers_.waiter.wake();
}

void Endpoint::publish(MapSnapshotPtr snapshot) {
  post([this, snapshot = std::move(snapshot)] { service_.publish(snapshot); });
}

void Endpoint::run() {
  while (true) {
    readers_.waiter.wait(time_to_wait());
    {
      const std::scoped_lock lock(mutex_);
      if (stopping_) return;
    }
    try {
      run_posted();
      take_messages();
      feed_clients();
      const MonotonicTime now = clock_->now();
      if (now >= service_.next_tick()) service_.tick(now);
      if (now >= door_.next_look()) look_who_is_at_the_door(now);
      if (now >= look_for_gone_at_) forget_gone_publications();
    } catch (const std::exception& problem) {
      log_->error("internal error: {}", problem.what());  // whatever a peer did: the others are served
    }
  }
}

milliseconds Endpoint::time_to_wait() const {
  MonotonicTime next = std::min(service_.next_tick(), door_.next_look());
  for (const auto& [name, link] : links_) {
    for (const auto& [map, feed] : link.feeds) {
      if (const auto due = feed.deadline()) next = std::min(next, *due);
    }
  }
  const MonotonicTime now = clock_->now();
  return next <= now ? milliseconds(0) : std::chrono::ceil<milliseconds>(next - now);
}

void Endpoint::run_posted() {
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

template <typename Message>
const Publications::Publication* Endpoint::identify(Inlet<Message>* inlet,
                                                    const wire::Sample<Message>& sample) {
  const Publications::Publication* source = inlet->source(sample);
  if (source == nullptr) return nullptr;  // the writer has gone meanwhile
  const ClientId claimed = sample.message ? sample.message->client : sample.key.client;
  if (!source->client || source->client->map || source->client_id != claimed) {
    refuse_identity(wire::topic_name<Message>(), source->partition, claimed);
    return nullptr;
  }
  return source;
}

bool Endpoint::serves(const Publications::Publication& source) {
  return !turns_away(IdentityRole::kClient, door_.client(source.client->client), source.process);
}

void Endpoint::refuse_identity(std::string_view topic, const std::string& partition, ClientId claimed) {
  if (!identity_warning_.due(clock_->now())) return;
  log_->warn("a {} from partition '{}' claims to be of client {}: refused", topic, partition,
             to_hex(claimed.bytes));
}

template <typename Message, typename Use>
void Endpoint::take_commands(Inlet<Message>* inlet, const Use& use) {
  wire::take_all(inlet->reader, [&](auto& sample) {
    const Publications::Publication* source = identify(inlet, sample);
    if (source != nullptr && serves(*source) && sample.message)
      use(door_.client(source->client->client), *source, std::move(*sample.message));
  });
}

void Endpoint::take_messages() {
  for (const wire::DiscoveredReader& reader : readers_.discovered.take()) on_discovered(reader);
  take_participants();  // who came and went meanwhile has been seen to be let in
  const auto hand_over = [this](const Principal& who, const auto&, auto message) {
    service_.take(who, std::move(message));
  };
  take_commands(&readers_.cameras, [this](const Principal& who, const auto& source, const auto& camera) {
    if (source.process) service_.sessions().announce(who, *source.process, camera);
  });
  take_states();
  take_commands(&readers_.seeds, hand_over);
  take_commands(&readers_.offers, hand_over);
  take_queries();
  take_commands(&readers_.client_requests, hand_over);
  take_requests();
  take_rigs();
}

void Endpoint::take_queries() {
  NewestQueries newest;
  take_commands(&readers_.queries, [&newest](const Principal& who, const auto&, wire::RelocQuery query) {
    newest.put(who, std::move(query));
  });
  newest.hand_over(
      [this](const Principal& who, wire::RelocQuery query) { service_.take(who, std::move(query)); });
}

void Endpoint::take_states() {
  wire::take_all(readers_.states.reader, [this](auto& sample) {
    if (!sample.message) {
      // No tracker disposes; anybody may under any key. That no writer of a key is left, the middleware says.
      if (sample.gone == wire::Gone::kNoWriters) service_.sessions().fell_silent(sample.key.client);
      return;
    }
    const Publications::Publication* source = identify(&readers_.states, sample);
    if (source == nullptr) return;
    wire::TrackerStateMessage& state = *sample.message;
    const std::string& name = source->client->client;
    if (!serves(*source)) return bid_farewell(name, state);
    state.wearer = door_.wearer_of(name, state.wearer);
    if (!service_.sessions().hear(door_.client(name), sample.publication, source->process, state)) return;
    const auto link = links_.find(name);
    if (link == links_.end()) return;
    const auto feed = link->second.feeds.find(state.map);
    if (feed != link->second.feeds.end()) feed->second.client_has(state.epoch, state.revision);
  });
}

void Endpoint::take_requests() {
  wire::take_all(readers_.requests.reader, [this](const auto& sample) {
    const Publications::Publication* source = readers_.requests.source(sample);
    const auto name = source != nullptr ? wire::parse_operator_partition(source->partition) : std::nullopt;
    if (!name || !sample.message) return;
    if (client_id_from_name(*name) != sample.message->operator_id) {
      return refuse_identity(wire::topic_name<wire::AdminRequest>(), source->partition,
                             sample.message->operator_id);
    }
    const Principal who = door_.operator_of(*name);
    if (!turns_away(IdentityRole::kOperator, who, source->process))
      return service_.take(who, *sample.message);
    wire::AdminReply reply = reply_of(
        refusal(ErrorCode::kRefused, std::string("operator ") + *name + ": " + Doorkeeper::kRevoked));
    reply.operator_id = sample.message->operator_id;
    reply.command = sample.message->command;
    check(write_reply(*name, reply), "an answer");
  });
}

/// A rig's orders pass the server by; what it says of them is all that there is for the record.
void Endpoint::take_rigs() {
  wire::take_all(readers_.rigs.reader, [this](const auto& sample) {
    const Publications::Publication* source = readers_.rigs.source(sample);
    if (!sample.message || source == nullptr || source->partition != wire::rig_partition(sample.message->rig))
      return;
    if (door_.is_turned_away(IdentityRole::kRig, sample.message->rig)) return;
    service_.take(*sample.message);
  });
}

void Endpoint::feed_clients() {
  const MonotonicTime now = clock_->now();
  std::vector<FeedTurns<MapFeed>::Waiting> waiting;
  for (auto& [name, link] : links_) {
    for (auto& [map, feed] : link.feeds) {
      const auto due = feed.deadline();
      if (due && *due <= now) waiting.push_back({name, map, link.authored.contains(map), &feed});
    }
  }
  turns_.take_turn(waiting, now);
}

void Endpoint::forget_gone_publications() {
  look_for_gone_at_ = clock_->now() + kLookForGone;
  const auto forget = [](auto&... inlets) { (inlets.publications.forget_gone(inlets.reader), ...); };
  forget(readers_.cameras, readers_.states, readers_.seeds, readers_.offers, readers_.queries,
         readers_.client_requests, readers_.requests, readers_.rigs);
}

void Endpoint::take_participants() {
  for (wire::DiscoveredParticipant& peer : readers_.participants.take()) {
    if (peer.gone) {
      door_.gone(peer.handle);
    } else {
      door_.came(peer.handle, std::move(peer.says), clock_->now());
    }
  }
}

void Endpoint::on_discovered(const wire::DiscoveredReader& reader) {
  if (!reader.gone) door_.is_let_in(reader.participant);
  if (reader.partitions.size() != 1) return;
  const auto identity = wire::parse_partition(reader.partitions.front());
  if (!identity) return;
  ClientLink& link = links_[identity->client];
  if (identity->map && is_map_topic(reader.topic)) {
    int& readers = link.wanted[*identity->map];
    readers += reader.gone ? -1 : 1;
    if (readers <= 0) {
      link.wanted.erase(*identity->map);
      link.feeds.erase(*identity->map);
    } else {
      open_wanted_feeds(identity->client, &link);
    }
  } else if (!identity->map && reader.topic == wire::topic_name<wire::ServerStatus>()) {
    link.status_readers += reader.gone ? -1 : 1;
    if (!reader.gone) link.process = reader.process;
    if (link.status_readers == 1 && !reader.gone) connect(identity->client, &link);
    if (link.status_readers == 0 && reader.gone) disconnect(identity->client, &link);
  }
  if (link.status_readers <= 0 && link.wanted.empty()) links_.erase(identity->client);
}

void Endpoint::connect(const std::string& name, ClientLink* link) {
  const Principal who = door_.client(name);
  if (turns_away(IdentityRole::kClient, who, link->process)) return;
  link->farewell.reset();
  auto writers = ClientWriters::create(participant_, name);
  if (!writers) return log_->error("{}: cannot be served: {}", name, writers.error().message);
  link->writers = std::move(*writers);
  service_.clients().connect(who);
}

void Endpoint::disconnect(const std::string& name, ClientLink* link) {
  link->feeds.clear();
  if (!link->writers) return;
  link->writers.reset();
  service_.clients().disconnect(door_.client(name));
}

void Endpoint::look_who_is_at_the_door(MonotonicTime now) {
  for (const wire::RefusedPeer& peer : door_.refused_to_be_told(now)) site_.note_refused(peer.who, peer.why);
  if (door_.look(now)) look_who_is_turned_away();
}

void Endpoint::look_who_is_turned_away() {
  site_.know_clients(door_.groups_of_clients());
  const auto is_turned_away = [this](const std::string& client) {
    return door_.is_turned_away(IdentityRole::kClient, client);
  };
  service_.clients().turn_away(door_.clients_turned_away());
  // Its writer keeps the last answer for whoever comes with those keys.
  std::erase_if(operators_, [this](const auto& known) {
    return door_.is_turned_away(IdentityRole::kOperator, known.first);
  });
  for (auto& [name, link] : links_) {
    if (is_turned_away(name)) {
      if (link.writers) (void)turns_away(IdentityRole::kClient, door_.client(name), link.process);
      disconnect(name, &link);
    } else if (!link.writers && link.status_readers > 0) {
      connect(name, &link);
      open_wanted_feeds(name, &link);
    }
  }
}

bool Endpoint::turns_away(IdentityRole role, const Principal& who,
                          const std::optional<wire::PeerId>& process) {
  if (!door_.is_turned_away(role, who.name)) return false;
  if (const auto why = door_.note_try(role, who.name, process, clock_->now()))
    site_.note_turned_away(who, *why);
  return true;
}

void Endpoint::bid_farewell(const std::string& name, const wire::TrackerStateMessage& state) {
  const auto link = links_.find(name);
  if (link == links_.end()) return;
  std::optional<Farewell>& farewell = link->second.farewell;
  if (!farewell) {
    auto to = wire::Writer<wire::OfferVerdict>::create(participant_, wire::client_partition(name));
    if (!to) return check(tl::unexpected(to.error()), "why a client is turned away");
    farewell.emplace(Farewell{std::move(*to), {}});
  }
  if (farewell->told == state.session || !farewell->again.due(clock_->now())) return;
  farewell->told = state.session;
  check(
      farewell->to.write({state.client, state.session, 0, 0, {notice_to_process(Doorkeeper::kYoursRevoked)}}),
      "why a client is turned away");
}

void Endpoint::open_wanted_feeds(const std::string& name, ClientLink* link) {
  const Principal who = door_.client(name);
  if (door_.is_turned_away(IdentityRole::kClient, name)) return;
  for (const auto& [map, readers] : link->wanted) {
    if (link->feeds.contains(map)) continue;
    const std::optional<FollowedMap> followed = service_.maps().follow(who, map);
    if (!followed) continue;
    const MonotonicTime now = clock_->now();
    if (link->feed_failed_at && now - *link->feed_failed_at < kFeedRetry) return;
    link->feed_failed_at = now;
    if (link->feeds.size() >= kMaxFeeds) return log_->warn("{}: wants too many maps at once", name);
    auto feed = MapFeed::create(participant_, name, map, blocks_of(map), log_);
    if (!feed)
      return log_->error("{}: map {} cannot be sent: {}", name, followed->newest->name, feed.error().message);
    link->feed_failed_at.reset();
    feed->update(followed->newest);
    for (const wire::LabelMessage& label : followed->labels) check(feed->show(label), "a label");
    link->feeds.emplace(map, std::move(*feed));
  }
}

std::shared_ptr<SerializedBlocks> Endpoint::blocks_of(MapId map) {
  auto& known = blocks_[map];
  auto blocks = known.lock();
  if (blocks == nullptr) known = blocks = std::make_shared<SerializedBlocks>();
  return blocks;
}

void Endpoint::check(const Status& written, const char* what) {
  if (!written && write_trouble_.due(clock_->now()))
    log_->error("{} could not be written: {}", what, written.error().message);
}

Status Endpoint::tell(const std::string& client, const ClientEvent& event) {
  const auto link = links_.find(client);
  if (link == links_.end()) return {};
  // Before it is said: what the client may not have, it is sent no more.
  if (const auto* gone = std::get_if<MapUnlisted>(&event)) {
    link->second.feeds.erase(gone->map);
    link->second.authored.erase(gone->map);
  }
  note_author(event, &link->second);
  if (!link->second.writers) return {};
  const Status written = write(*link->second.writers, event);
  if (std::holds_alternative<wire::MapInfo>(event)) open_wanted_feeds(client, &link->second);
  return written;
}

Status Endpoint::answer(const std::string& operator_name, const wire::AdminReply& reply) {
  // What was under way when its keys were revoked is not for whoever has them now.
  if (door_.is_turned_away(IdentityRole::kOperator, operator_name)) return {};
  return write_reply(operator_name, reply);
}

Status Endpoint::write_reply(const std::string& operator_name, const wire::AdminReply& reply) {
  auto known = std::ranges::find(operators_, operator_name, &OperatorWriters::value_type::first);
  if (known == operators_.end()) {
    auto made = wire::Writer<wire::AdminReply>::create(participant_, wire::operator_partition(operator_name));
    if (!made) return tl::unexpected(made.error());
    while (operators_.size() >= AdminGate::kMostRuns) operators_.pop_back();
    known = operators_.emplace(operators_.begin(), operator_name, std::move(*made));
  }
  operators_.splice(operators_.begin(), operators_, known);
  return known->second.write(reply);
}

void Endpoint::revised(MapId map, const MapSnapshotPtr& newest) {
  for (auto& [name, link] : links_) {
    const auto feed = link.feeds.find(map);
    if (feed != link.feeds.end()) {
      feed->second.update(newest);
    } else if (link.wanted.contains(map)) {
      open_wanted_feeds(name, &link);
    }
  }
}

void Endpoint::labelled(const wire::LabelMessage& label) {
  for (auto& [name, link] : links_) {
    const auto feed = link.feeds.find(label.map);
    if (feed != link.feeds.end()) check(feed->second.show(label), "a label");
  }
}

void Endpoint::label_removed(MapId map, LabelId label) {
  for (auto& [name, link] : links_) {
    const auto feed = link.feeds.find(map);
    if (feed != link.feeds.end()) check(feed->second.hide(map, label), "a label");
  }
}

void Endpoint::ended(MapId map) {
  for (auto& [name, link] : links_) {
    link.feeds.erase(map);
    link.authored.erase(map);
  }
  blocks_.erase(map);
}

}  // namespace cairn
