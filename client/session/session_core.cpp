// SPDX-License-Identifier: Apache-2.0
#include "client/session/session_core.h"

#include <algorithm>
#include <utility>

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr size_t kMostRequests = 32;  ///< undecided, of a person
constexpr milliseconds kLeastStateInterval{16};
/// Keeps the name held (server: 3 s of silence) and the replica's progress known.
constexpr milliseconds kMostStateInterval{200};
constexpr const char* kRestartedText = "server restarted without this map";

template <typename T>
void append(std::vector<T> more, std::vector<T>* all) {
  std::ranges::move(more, std::back_inserter(*all));
}

}  // namespace

SessionCore::SessionCore(SessionOptions options, const CameraPtr& camera,
                         std::function<SessionId()> new_session)
    : options_(std::move(options)),
      new_session_(std::move(new_session)),
      session_(new_session_()),
      spool_(options_.spool_limit, session_),
      seed_(session_),
      query_(session_),
      requests_(kMostRequests, session_),
      camera_(client_id_from_name(options_.name), options_.prior_sigma, camera),
      maps_(options_.recent_maps, options_.only_map) {
  tracker_.client = client_id_from_name(options_.name);
  tracker_.wearer = options_.wearer;
}

void SessionCore::choose_map(MapId map) {
  if (maps_.choose(map)) restarted_ = false;
}

void SessionCore::use_map(MapId map, Epoch epoch, Revision revision) {
  choose_map(map);
  if (map) maps_.require({map, epoch, revision});
  tracker_changed_ = true;
}

void SessionCore::leave_map() {
  seed_.drop();
  seed_reply_.reset();
  query_.drop();
  relocalization_answer_.reset();
  use_map({}, {}, {});
}

void SessionCore::send_seed(SeedProposal proposal) {
  seed_.put(std::move(proposal));
  actions_.look_what_to_send = true;
}

void SessionCore::send_offer(SpooledOffer offer) {
  if (!is_map_known()) {
    offer_replies_.push_back({0, false, kRestartedText, {}, offer.time, offer.proposal.number});
    return;
  }
  if (auto lost = spool_.push(std::move(offer))) offer_replies_.push_back(std::move(*lost));
  actions_.look_what_to_send = true;
}

void SessionCore::send_query(std::shared_ptr<const PlaceView> view, Timestamp time) {
  if (monitor_.link() != ServerLink::kConnected) return;
  relocalization_answer_.reset();  // of an older one
  query_.put({std::move(view), maps_.in_use(), time});
  actions_.look_what_to_send = true;
}

void SessionCore::send_request(wire::ClientRequest request) {
  if (options_.reads_only || !is_map_known()) {
    const char* why = options_.reads_only ? "a reader changes no labels" : kRestartedText;
    request_replies_.push_back(RequestTopic::reply({}, 0, false, why));
    return;
  }
  if (auto lost = requests_.push(std::move(request))) request_replies_.push_back(std::move(*lost));
  actions_.look_what_to_send = true;
}

void SessionCore::publish_state(const FrameResult& result, Timestamp time) {
  tracker_.state = result.state;
  tracker_.map = result.map;
  tracker_.camera_from_map = result.camera_from_map;
  tracker_.quality = result.quality;
  tracker_.frame_time = time;
  tracker_changed_ = true;
  actions_.look_what_to_send = true;
}

std::optional<CameraUpdate> SessionCore::take_camera(const MapSnapshotPtr& snapshot) {
  if (snapshot == nullptr && maps_.in_use()) return std::nullopt;
  auto update = snapshot ? camera_.use_values_of(*snapshot) : camera_.use_first_values();
  actions_.look_what_to_send |= update.has_value();
  return update;
}

void SessionCore::take(const wire::ServerStatus& status) {
  act_on(monitor_.heard(status.server, status.start_count));
}

void SessionCore::take_presence(bool is_alive) {
  act_on(monitor_.alive(is_alive));
  if (maps_.is_bound() && !maps_.in_use()) choose_map(maps_.only(monitor_));
}

void SessionCore::act_on(LinkMonitor::Event event) {
  using Event = LinkMonitor::Event;
  using Level = Actions::Notice::Level;
  if (event == Event::kNone) return;
  if (event == Event::kRestarted) {
    say(Level::kWarning, "the server has been started anew");
    begin_anew();
  } else if (event == Event::kGone) {
    say(Level::kDebug, "the server is gone");  // status() says so, and what it means for the tracker
    query_.drop();
  } else {
    say(Level::kInfo, "connected to " + options_.server);
    spool_.resend_all();
    requests_.resend_all();
    seed_.resend();
  }
  tracker_changed_ = true;
  actions_.look_what_to_send = actions_.look_what_changed = true;
}

/// Begins a new session, with a server that knows nothing of us.
void SessionCore::begin_anew() {
  restarted_ = true;
  session_ = new_session_();
  commands_.clear();
  seed_.restart(session_);
  query_.drop();
  query_.restart(session_);
  append(requests_.restart(session_, kRestartedText), &request_replies_);
  append(spool_.restart(session_, kRestartedText), &offer_replies_);
}

void SessionCore::take(const wire::MapInfo& listed) {
  monitor_.map_listed(listed.map, listed.server);
  maps_.listed(listed.map, listed.name);
  terms_[listed.map] = {listed.right, listed.takes_proposals};
}

void SessionCore::take_unlisted(MapId map) {
  monitor_.map_removed(map);
  maps_.removed(map);
  terms_.erase(map);
}

void SessionCore::take(const wire::SeedVerdict& verdict) {
  if (!seed_.apply(verdict)) return;
  if (verdict.accepted) {
    seed_reply_ = SeedReply{
        SeedAnswer{verdict.map, verdict.epoch, verdict.revision, verdict.second_keyframe, verdict.points},
        {}};
    choose_map(verdict.map);
    own_map_ = verdict.map;
    monitor_.map_listed(verdict.map, monitor_.server());
    maps_.require({verdict.map, verdict.epoch, verdict.revision});
  } else {
    seed_reply_ = SeedReply{std::nullopt, verdict.reason};
  }
  actions_.look_what_changed = true;
}

void SessionCore::take(const wire::OfferVerdict& verdict) {
  if (verdict.session != session_) return;
  // Sequence 0 is no offer: the server tells why it does not serve this process at all.
  const auto notice = std::ranges::find(verdict.recent, uint64_t{0}, &wire::OfferOutcome::seq);
  const std::string refusal = notice == verdict.recent.end() ? "" : notice->reason;
  if (refusal != refusal_) {
    if (!refusal.empty()) say(Actions::Notice::Level::kWarning, "the server does not serve us: " + refusal);
    refusal_ = refusal;
    seed_.resend();  // what went unheard while we were refused
    spool_.resend_all();
    requests_.resend_all();
  }
  name_held_ = refusal.empty();
  append(spool_.apply(verdict), &offer_replies_);
  if (!verdict.recent.empty() && verdict.recent.back().revision) {
    const wire::OfferOutcome& newest = verdict.recent.back();
    maps_.require({newest.map, newest.epoch, newest.revision});
  }
  actions_.look_what_to_send = actions_.look_what_changed = true;  // there may be credit again
}

void SessionCore::take(const wire::ClientReply& reply) {
  append(requests_.apply(reply), &request_replies_);
  actions_.look_what_to_send = actions_.look_what_changed = true;  // there may be credit again
}

void SessionCore::take(wire::RelocAnswer answer) {
  if (!query_.apply(answer)) return;
  RelocalizationAnswer& place = relocalization_answer_.emplace(std::move(answer.answer));
  if (maps_.is_bound()) {
    std::erase_if(place.candidates, [&](const PlaceCandidate& c) { return c.map != maps_.in_use(); });
    if (place.candidates.empty()) place.verdict = RelocalizationVerdict::kNotKnown;
  }
  actions_.look_what_changed = true;
}

void SessionCore::take(const wire::CameraEstimate& estimate) {
  if (!camera_.take(estimate))
    say(Actions::Notice::Level::kWarning, "what a map says of the camera cannot be: it is not used");
}

void SessionCore::take_forgotten(const wire::CameraEstimate& key) {
  camera_.forget(key);
}

bool SessionCore::take(const MapSnapshotPtr& revision) {
  if (!maps_.is_recent(revision->map) || !camera_.has_values_of(*revision)) return false;
  const bool is_in_use = maps_.swap_in(revision);
  if (revision->map == own_map_) {
    own_map_ = {};
    if (!camera_.is_self_calibrated_by(*revision)) {
      say(Actions::Notice::Level::kWarning,
          "this server does not self-calibrate cameras: its map takes what is believed of ours for exact; pass "
          "--calibration FILE, exact:FILE where it has no distortion");
    }
  }
  if (!is_in_use) return true;
  tracker_changed_ = true;  // the server waits to hear that this revision is in use
  actions_.look_what_to_send = actions_.look_what_changed = true;
  return true;
}

std::optional<SessionCore::Outgoing> SessionCore::next(MonotonicTime now, const Readers& readers) {
  if (auto camera = camera_.next_announcement()) return std::move(*camera);
  if (now >= next_due()) {
    state_sent_ = now;
    tracker_changed_ = false;
    camera_.try_again();
    return state_to_send();
  }
  if (!camera_.is_announced() || monitor_.link() != ServerLink::kConnected) return std::nullopt;
  return next_command(now, readers);
}

MonotonicTime SessionCore::next_due() const {
  return state_sent_ + (tracker_changed_ ? kLeastStateInterval : kMostStateInterval);
}

std::optional<SessionCore::Outgoing> SessionCore::next_command(MonotonicTime now, const Readers& readers) {
  if (readers.queries) {
    if (auto query = query_.next(now)) return std::move(*query);
  }
  if (readers.seeds) {
    if (auto seed = seed_.next(now)) return std::move(*seed);
  }
  if (readers.offers) {
    if (auto offer = spool_.next(now)) {
      tell_of_proposals(offer->item->proposal.map);
      const uint64_t reference = sent(offer->item->proposal, offer->command.seq);
      return Offer{std::move(*offer), reference};
    }
  }
  if (readers.requests) {
    if (auto request = requests_.next(now)) return std::move(*request);
  }
  return std::nullopt;
}

void SessionCore::tell_of_proposals(MapId map) {
  if (map == proposed_to_ || keyframe_use(map) != KeyframeUse::kProposal) return;
  proposed_to_ = map;
  say(Actions::Notice::Level::kInfo,
      "this map takes proposals: some images of it go to the server, whose operator may add them to the "
      "map; --no-proposals keeps them here");
}

uint64_t SessionCore::sent(const KeyframeProposal& proposal, uint64_t command) {
  commands_[proposal.number] = command;
  if (commands_.size() > 2 * options_.spool_limit) commands_.erase(commands_.begin());
  const auto reference = commands_.find(proposal.reference_number);
  return proposal.reference_number == 0 || reference == commands_.end() ? 0 : reference->second;
}

wire::TrackerStateMessage SessionCore::state_to_send() const {
  wire::TrackerStateMessage message = tracker_;
  message.session = session_;
  // The pose of the frame may be in the map that was in use before.
  const MapSnapshotPtr replica = maps_.replica_in_use();
  if (message.map != maps_.in_use() && message.state != TrackingState::kStarting) {
    message.state = TrackingState::kLost;
  }
  message.map = maps_.in_use();
  message.epoch = replica ? replica->epoch : Epoch{};
  message.revision = replica ? replica->revision : Revision{};
  return message;
}

KeyframeUse SessionCore::keyframe_use(MapId map) const {
  const auto known = terms_.find(map);
  const MapTerms said = known == terms_.end() ? MapTerms{} : known->second;
  if (!options_.reads_only && said.right != wire::MapRight::kRead) return KeyframeUse::kKeyframe;
  if (said.takes_proposals) return options_.proposes ? KeyframeUse::kProposal : KeyframeUse::kNothing;
  return options_.reads_only ? KeyframeUse::kNothing : KeyframeUse::kKeyframe;
}

bool SessionCore::is_map_known() const {
  return !maps_.in_use() || !restarted_ || monitor_.knows(maps_.in_use());
}

bool SessionCore::is_settled() const {
  return seed_.empty() && spool_.size() == 0 && query_.empty() && requests_.size() == 0 && maps_.is_current();
}

/// A server that was started anew does not as much as answer whose keys are revoked: the middleware tells
/// neither of the two.
std::string SessionCore::text_of_silence() const {
  const std::string gone =
      options_.security.empty() ? "server gone" : "server gone, or it no longer accepts our keys";
  if (!maps_.snapshot()) return gone;
  return gone + (tracker_.state == TrackingState::kLost
                     ? ": lost; searching from where it was last, no more can be done"
                     : ": tracking on the replica");
}

SessionStatus SessionCore::status() const {
  SessionStatus status;
  status.link = monitor_.link();
  status.map_known = is_map_known();
  status.waits_for_map = maps_.in_use() && maps_.replica_in_use() == nullptr &&
                         monitor_.knows(maps_.in_use()) && status.link == ServerLink::kConnected;
  status.spooled = spool_.size();
  if (!refusal_.empty()) {
    // Also when it is not heard any more: whose keys are revoked is told so, and nothing else from then on.
    const bool is_silent = status.link == ServerLink::kGone;
    status.link = ServerLink::kRefused;
    status.text = refusal_ + (is_silent ? "; the server is not heard any more" : "");
  } else if (status.link == ServerLink::kConnecting) {
    status.text = "waiting for a server at " + options_.server;
  } else if (status.link == ServerLink::kGone) {
    status.text = text_of_silence();
  } else if (!status.map_known) {
    status.link = ServerLink::kRestarted;
    status.text = std::string(kRestartedText) + ": it begins a new one when lost, or asked to";
  } else if (camera_.is_unsound(maps_.in_use())) {
    status.text = "what the map says of the camera cannot be: it is not tracked on";
  } else {
    status.text = "connected to " + options_.server;
  }
  return status;
}

}  // namespace cairn
