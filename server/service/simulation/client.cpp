// SPDX-License-Identifier: Apache-2.0
#include "server/service/simulation/client.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <type_traits>
#include <utility>

#include "server/service/simulation/views.h"

namespace cairn::simulation {
namespace {

template <typename Command>
void note_arrival(History* history, const std::string& client, const Command& command) {
  history->arrives(client, command);
}
/// A query leaves nothing behind.
void note_arrival(History* /*history*/, const std::string& /*client*/, const wire::RelocQuery& /*query*/) {}

using std::chrono::milliseconds;

/// What replaces each other on its way: the newest counts.
std::pair<size_t, MapId> instance_of(const Delivery& delivery) {
  const auto* event = std::get_if<ClientEvent>(&delivery);
  if (event == nullptr) {
    const auto* snapshot = std::get_if<MapSnapshotPtr>(&delivery);
    return snapshot == nullptr ? std::pair<size_t, MapId>{} : std::pair(size_t{100}, (*snapshot)->map);
  }
  if (const auto* info = std::get_if<wire::MapInfo>(event)) return {101, info->map};
  if (const auto* gone = std::get_if<MapUnlisted>(event)) return {101, gone->map};
  return {event->index() + 1, {}};
}

}  // namespace

SimulatedClient::SimulatedClient(World* world, std::string name)
    : world_(*world), name_(std::move(name)), id_(client_id_from_name(name_)) {
  begin_process();
}

void SimulatedClient::begin_process() {
  world_.forget(name_);
  session_ = SessionId{world_.random()};
  for (uint8_t& byte : process_.bytes) byte = static_cast<uint8_t>(world_.random());
  publication_ = {world_.random()};
  coming_.clear();
  listed_.clear();
  replicas_.clear();
  seed_.reset();
  query_.reset();
  offers_.clear();
  requests_.clear();
  steps_.clear();
  last_seed_ = last_offer_ = last_request_ = last_query_ = offers_decided_ = requests_decided_ = 0;
  connect_at_ = world_.clock->now() + world_.between(0, 800);
}

void SimulatedClient::cut_off() {
  is_connected_ = false;
  coming_.clear();
  connect_at_ = world_.clock->now() + world_.between(0, 1500);
}

void SimulatedClient::connect() {
  is_connected_ = true;
  listed_.clear();
  world_.history.connected(name_);
  world_.server->peers().connect(name_);
  speak_at_ = send_at_ = world_.clock->now();
  for (const auto& [map, replica] : replicas_) world_.server->peers().want(name_, map);
}

void SimulatedClient::act() {
  const MonotonicTime now = world_.clock->now();
  if (!is_connected_) {
    if (world_.server != nullptr && now >= connect_at_) connect();
    return;
  }
  const bool goes = !world_.is_calm && world_.chance(0.004);
  if (goes) {
    world_.server->peers().disconnect(name_);
    cut_off();
    // The process ends, or only the network is gone for a while.
    if (world_.chance(0.5)) begin_process();
    return;
  }
  take_in_something();
  if (now >= speak_at_) {
    speak_at_ = now + world_.between(200, 600);
    wire::TrackerStateMessage state;
    state.client = id_;
    state.session = session_;
    state.frame_time = Timestamp{now.time_since_epoch().count()};
    if (!replicas_.empty()) {
      state.map = replicas_.begin()->first;
      state.state = TrackingState::kTracking;
    }
    world_.send(name_, [=, name = name_, process = process_, publication = publication_](ServerRun& server) {
      (void)server.service().sessions().hear(client_principal(name), publication, process, state);
    });
    wire::CameraMessage camera;
    camera.client = id_;
    camera.parameters = Views::of_place(0).camera()->parameters();
    world_.send(name_, [=, name = name_, process = process_](ServerRun& server) {
      server.service().sessions().announce(client_principal(name), process, camera);
    });
  }
  if (now >= send_at_) {
    send_at_ = now + world_.between(300, 1200);
    send_again();
  }
  if (now >= begin_at_ && !world_.is_calm) {
    begin_at_ = now + world_.between(100, 2500);
    begin_something();
  }
}

void SimulatedClient::send_again() {
  const auto send = [this](const auto& command) {
    world_.send(name_, [command, name = name_, &history = world_.history](ServerRun& server) {
      note_arrival(&history, name, command);
      server.service().take(client_principal(name), command);
    });
  };
  if (seed_) send(*seed_);
  if (query_) send(*query_);
  for (const auto& [seq, offer] : offers_) {
    if (seq <= offers_decided_ + OfferGate::kCredit) send(offer);
  }
  for (const auto& [seq, request] : requests_) {
    if (seq <= requests_decided_ + RequestGate::kCredit) send(request);
  }
}

void SimulatedClient::begin_something() {
  const size_t kind = world_.draw(10);
  if (kind == 0 || replicas_.empty()) {
    begin_seed();
  } else if (kind < 6) {
    begin_offer();
  } else if (kind < 8) {
    begin_request();
  } else {
    begin_query();
  }
  send_at_ = std::min(send_at_, world_.clock->now() + world_.between(0, 100));
}

void SimulatedClient::begin_seed() {
  constexpr size_t kMostMaps = 3;
  if (seed_ || (world_.history.maps().size() >= kMostMaps && !world_.chance(0.1))) return;
  const size_t place = world_.draw(Views::kPlaces);
  wire::MapSeed seed = Views::of_place(place).seed();
  seed.client = id_;
  seed.command = {session_, ++last_seed_};
  seed.first_time = world_.next_image();
  seed.second_time = world_.next_image();
  if (world_.chance(0.5)) seed.map_name = "desk";
  if (world_.chance(0.1)) std::swap(seed.first_image, seed.second_image);  // no map comes of it
  seed_places_[seed.command] = place;
  seed_ = std::move(seed);
}

const MapSnapshot* SimulatedClient::replica_of(MapId map) const {
  const auto replica = replicas_.find(map);
  return replica == replicas_.end() ? nullptr : replica->second.newest.get();
}

std::optional<MapId> SimulatedClient::some_map() {
  if (world_.chance(0.05)) {
    const std::vector<MapId> all = world_.history.maps();
    if (!all.empty()) return all[world_.draw(all.size())];
  }
  if (replicas_.empty()) return std::nullopt;
  return std::next(replicas_.begin(), static_cast<std::ptrdiff_t>(world_.draw(replicas_.size())))->first;
}

void SimulatedClient::begin_offer() {
  const auto map = some_map();
  if (!map || offers_.size() > 2 * OfferGate::kCredit) return;
  const MapSnapshot* replica = replica_of(*map);
  const auto place = world_.places.find(*map);
  if (place == world_.places.end()) return;
  const int step = 1 + static_cast<int>(world_.draw(Views::kSteps - 1));
  wire::KeyframeOffer offer;
  if (replica != nullptr) {
    auto tracked = Views::of_place(place->second).offer(*replica, step);
    if (!tracked) return;
    offer = std::move(*tracked);
  } else {
    offer.map = *map;  // of which it knows the id only
    offer.image = Views::of_place(place->second).seed().first_image;
  }
  offer.client = id_;
  offer.command = {session_, ++last_offer_};
  offer.time = world_.next_image();
  // Some are tracked on a frame that was offered before, as while the server is away.
  const auto earlier = steps_.empty() ? steps_.end() : std::prev(steps_.end());
  if (replica != nullptr && earlier != steps_.end() && earlier->second.first == *map && world_.chance(0.3)) {
    offer.reference_command = earlier->first;
    offer.camera_from_reference = Views::motion(earlier->second.second, step, *replica);
  }
  if (replica != nullptr) steps_[last_offer_] = {*map, step};
  offer.as_proposal = replica != nullptr && world_.chance(0.3);
  if (world_.chance(0.1)) offer.measurements.resize(offer.measurements.size() / 20);
  offers_.emplace(last_offer_, std::move(offer));
}

void SimulatedClient::begin_query() {
  if (query_) return;
  const size_t place = world_.draw(Views::kPlaces);
  wire::RelocQuery query = Views::of_place(place).query(static_cast<int>(world_.draw(Views::kSteps)));
  query.client = id_;
  query.command = {session_, ++last_query_};
  query.lockstep = world_.chance(0.2);
  query_ = std::move(query);
}

void SimulatedClient::begin_request() {
  const auto map = some_map();
  if (!map || requests_.size() > RequestGate::kCredit) return;
  wire::ClientRequest request;
  request.client = id_;
  request.command = {session_, ++last_request_};
  request.map = *map;
  request.text = fmt::format("{} {} {}", name_, session_.value % 10000, last_request_);
  const auto replica = replicas_.find(*map);
  const bool has_labels = replica != replicas_.end() && !replica->second.labels.empty();
  if (has_labels && world_.chance(0.5)) {
    const auto& labels = replica->second.labels;
    request.label = std::next(labels.begin(), static_cast<std::ptrdiff_t>(world_.draw(labels.size())))->first;
    request.action =
        world_.chance(0.5) ? wire::RequestAction::kRenameLabel : wire::RequestAction::kRemoveLabel;
  } else {
    request.reference = KeyframeId{1};
    request.reference_from_label = SE3(Eigen::Quaterniond::Identity(), {0, 0, 1});
    if (replica != replicas_.end() && replica->second.newest) request.epoch = replica->second.newest->epoch;
  }
  requests_.emplace(last_request_, std::move(request));
}

void SimulatedClient::receive(const Delivery& delivery) {
  if (is_connected_) coming_.push_back(delivery);
}

void SimulatedClient::take_in_something() {
  for (size_t n = world_.is_calm ? coming_.size() : world_.draw(4); n > 0 && !coming_.empty(); --n) {
    const Delivery delivery = std::move(coming_.front());
    coming_.pop_front();
    const auto instance = instance_of(delivery);
    const bool is_overtaken =
        instance.first != 0 && std::any_of(coming_.begin(), coming_.end(), [&](const Delivery& later) {
          return instance_of(later) == instance;
        });
    if (!is_overtaken || world_.chance(0.5)) take_in(delivery);
  }
}

void SimulatedClient::take_in(const Delivery& delivery) {
  if (const auto* event = std::get_if<ClientEvent>(&delivery)) return take_in(*event);
  if (const auto* snapshot = std::get_if<MapSnapshotPtr>(&delivery)) {
    const auto replica = replicas_.find((*snapshot)->map);
    if (replica == replicas_.end()) return;  // what it wanted once
    MapSnapshotPtr& newest = replica->second.newest;
    if (newest != nullptr &&
        std::pair((*snapshot)->epoch, (*snapshot)->revision) < std::pair(newest->epoch, newest->revision))
      world_.history.violated(name_ + ": a map that it follows goes back");
    newest = *snapshot;
  } else if (const auto* label = std::get_if<wire::LabelMessage>(&delivery)) {
    const auto replica = replicas_.find(label->map);
    if (replica != replicas_.end()) replica->second.labels[label->label.id] = label->label;
  } else if (const auto* removed = std::get_if<LabelRemoved>(&delivery)) {
    const auto replica = replicas_.find(removed->map);
    if (replica != replicas_.end()) replica->second.labels.erase(removed->label);
  }
}

template <typename Verdict, typename Command>
void SimulatedClient::settle(const Verdict& verdict, std::map<uint64_t, Command>* pending) {
  pending->erase(pending->begin(), pending->upper_bound(verdict.last_decided));
  for (const auto& outcome : verdict.recent) pending->erase(outcome.seq);
}

void SimulatedClient::take_in(const ClientEvent& event) {
  if (const auto* offers = std::get_if<wire::OfferVerdict>(&event)) {
    if (offers->session != session_) return;
    settle(*offers, &offers_);
    offers_decided_ = std::max(offers_decided_, offers->last_decided);
  } else if (const auto* requests = std::get_if<wire::ClientReply>(&event)) {
    if (requests->session != session_) return;
    settle(*requests, &requests_);
    requests_decided_ = std::max(requests_decided_, requests->last_decided);
  } else if (const auto* seed = std::get_if<wire::SeedVerdict>(&event)) {
    if (seed->command.session == session_ && seed_ && seed_->command.seq == seed->command.seq) seed_.reset();
  } else if (const auto* answer = std::get_if<wire::RelocAnswer>(&event)) {
    if (answer->command.session == session_ && query_ && query_->command.seq == answer->command.seq)
      query_.reset();
  } else if (const auto* info = std::get_if<wire::MapInfo>(&event)) {
    listed_[info->map] = *info;
    if (replicas_.contains(info->map) || !world_.chance(0.8)) return;
    replicas_[info->map];
    world_.server->peers().want(name_, info->map);
  } else if (const auto* gone = std::get_if<MapUnlisted>(&event)) {
    listed_.erase(gone->map);
    replicas_.erase(gone->map);
    world_.server->peers().want_no_more(name_, gone->map);
  }
}

std::string SimulatedClient::waits_for() const {
  if (!is_connected_) return "to be connected";
  if (seed_) return "the verdict on a seed";
  if (!offers_.empty()) return fmt::format("the verdict on offer {}", offers_.begin()->first);
  if (!requests_.empty()) return fmt::format("the verdict on request {}", requests_.begin()->first);
  return query_ ? "an answer to a query" : "";
}

}  // namespace cairn::simulation
