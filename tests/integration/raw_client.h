// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "client/session/image_encoder.h"
#include "common/image/place.h"
#include "common/wire/partition.h"
#include "common/wire/topic.h"
#include "tests/integration/two_views.h"

/// The protocol as a client without manners speaks it: written on the wire itself, whether anybody is there
/// or not. A Session holds back what it has to say until a server has answered it.
namespace cairn::testing {

template <typename T>
T value_of(Result<T> result) {
  if (!result) throw std::runtime_error(result.error().message);
  return std::move(*result);
}

class RawClient {
 public:
  static wire::ParticipantOptions joining(int domain) {
    wire::ParticipantOptions options;
    options.domain = static_cast<uint32_t>(domain);
    return options;
  }
  RawClient(int domain, const std::string& name, const CameraPtr& camera)
      : RawClient(joining(domain), name, camera) {}
  RawClient(const wire::ParticipantOptions& joining, const std::string& name, const CameraPtr& camera)
      : id(client_id_from_name(name)),
        participant_(value_of(wire::Participant::create(joining))),
        partition_(wire::client_partition(name)),
        cameras_(writer<wire::CameraMessage>()),
        states_(writer<wire::TrackerStateMessage>()),
        seeds(writer<wire::MapSeed>()),
        offers(writer<wire::KeyframeOffer>()),
        queries(writer<wire::RelocQuery>()),
        requests(writer<wire::ClientRequest>()),
        status_(reader<wire::ServerStatus>()),
        maps_(reader<wire::MapInfo>()),
        seed_verdicts_(reader<wire::SeedVerdict>()),
        offer_verdicts_(reader<wire::OfferVerdict>()),
        answers_(reader<wire::RelocAnswer>()),
        replies_(reader<wire::ClientReply>()) {
    announce(camera->parameters());
  }

  void announce(const CameraParameters& parameters) {
    wire::CameraMessage message;
    message.client = id;
    message.parameters = parameters;
    (void)cameras_.write(message);
  }
  /// Receives a map if the server sends it.
  void use_map(const MapId& map) {
    commits_.emplace(value_of(
        wire::Reader<wire::MapCommit>::create(participant_, partition_ + ".map." + to_hex(map.bytes))));
  }

  /// Says that it is there, as trackers do.
  void say_state() { say_state_of(id); }
  void say_state_of(ClientId who) {
    wire::TrackerStateMessage state;
    state.client = who;
    state.session = session;
    (void)states_.write(state);
  }
  /// That too, and takes what the server says.
  void spin() {
    say_state();
    newest(seed_verdicts_, &seed_verdict);
    newest(offer_verdicts_, &offer_verdict);
    newest(answers_, &answer);
    newest(replies_, &reply);
    newest(maps_, &map_info);
    newest(status_, &server_status);
    if (commits_) newest(*commits_, &commit);
  }
  /// As if the tracker of that name had ended in good order.
  void dispose_state_of(ClientId who) {
    wire::TrackerStateMessage key;
    key.client = who;
    (void)states_.dispose(key);
  }
  /// Servers whose readers its writers reach.
  [[nodiscard]] int servers() const { return requests.matched(); }
  /// Anything but why it is not served.
  [[nodiscard]] bool has_heard_anything() const {
    return seed_verdict || (offer_verdict && why_not_served().empty()) || answer || reply || map_info ||
           server_status || commit;
  }
  /// Empty: it has not been told.
  [[nodiscard]] std::string why_not_served() const {
    const bool is_notice = offer_verdict && offer_verdict->last_decided == 0 &&
                           offer_verdict->recent.size() == 1 && offer_verdict->recent.front().seq == 0;
    return is_notice ? offer_verdict->recent.front().reason : std::string();
  }
  void forget_what_was_heard() {
    seed_verdict.reset();
    offer_verdict.reset();
    answer.reset();
    reply.reset();
    map_info.reset();
    server_status.reset();
    commit.reset();
  }
  /// To everything that was asked.
  [[nodiscard]] bool has_every_answer() const {
    return seed_verdict && offer_verdict && !offer_verdict->recent.empty() && answer && reply &&
           !reply->recent.empty() && map_info && server_status && commit;
  }

  ClientId id;
  SessionId session{1001};

 private:
  template <typename Message>
  wire::Writer<Message> writer() {
    return value_of(wire::Writer<Message>::create(participant_, partition_));
  }
  template <typename Message>
  wire::Reader<Message> reader() {
    return value_of(wire::Reader<Message>::create(participant_, partition_));
  }
  template <typename Message>
  static void newest(wire::Reader<Message>& from, std::optional<Message>* to) {
    for (auto& sample : from.take()) {
      if (sample.message) *to = std::move(sample.message);
    }
  }

  wire::Participant participant_;
  std::string partition_;
  wire::Writer<wire::CameraMessage> cameras_;
  wire::Writer<wire::TrackerStateMessage> states_;

 public:
  wire::Writer<wire::MapSeed> seeds;
  wire::Writer<wire::KeyframeOffer> offers;
  wire::Writer<wire::RelocQuery> queries;
  wire::Writer<wire::ClientRequest> requests;
  std::optional<wire::SeedVerdict> seed_verdict;
  std::optional<wire::OfferVerdict> offer_verdict;
  std::optional<wire::RelocAnswer> answer;
  std::optional<wire::ClientReply> reply;
  std::optional<wire::MapInfo> map_info;
  std::optional<wire::ServerStatus> server_status;
  std::optional<wire::MapCommit> commit;

 private:
  wire::Reader<wire::ServerStatus> status_;
  wire::Reader<wire::MapInfo> maps_;
  wire::Reader<wire::SeedVerdict> seed_verdicts_;
  wire::Reader<wire::OfferVerdict> offer_verdicts_;
  wire::Reader<wire::RelocAnswer> answers_;
  wire::Reader<wire::ClientReply> replies_;
  std::optional<wire::Reader<wire::MapCommit>> commits_;
};

/// What a tracker would say of the map maker's test scene.
[[nodiscard]] inline wire::MapSeed seed_of(const RawClient& client, uint64_t seq, const Scene& scene) {
  const SeedProposal proposal = make_seed(scene);
  wire::MapSeed seed;
  seed.client = client.id;
  seed.command = {client.session, seq};
  seed.first_time = proposal.first_time;
  seed.second_time = proposal.second_time;
  seed.first_image = encode_image(*proposal.first_image, wire::ImageEncoding::kRaw);
  seed.second_image = encode_image(*proposal.second_image, wire::ImageEncoding::kJpeg);
  seed.trails = proposal.trails;
  seed.second_from_first = proposal.second_from_first;
  return seed;
}

[[nodiscard]] inline wire::KeyframeOffer offer_of(const RawClient& client, uint64_t seq, const Scene& scene,
                                                  const MapSnapshot& map, int step) {
  const Frame frame = make_offer(scene, map, step);
  wire::KeyframeOffer offer;
  offer.client = client.id;
  offer.command = {client.session, seq};
  offer.map = frame.proposal.map;
  offer.epoch = frame.proposal.epoch;
  offer.revision = frame.proposal.revision;
  offer.reference = frame.proposal.reference;
  offer.camera_from_reference = frame.proposal.camera_from_reference;
  offer.image = encode_image(*frame.image, wire::ImageEncoding::kJpeg);
  offer.measurements = frame.proposal.measurements;
  return offer;
}

[[nodiscard]] inline wire::RelocQuery query_of(const RawClient& client, uint64_t seq, const PlaceView& view) {
  wire::RelocQuery query;
  query.client = client.id;
  query.command = {client.session, seq};
  query.small_image = encode_image(view.small, wire::ImageEncoding::kRaw);
  query.corners = view.corners;
  return query;
}

}  // namespace cairn::testing
