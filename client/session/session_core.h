// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "client/session/camera_negotiation.h"
#include "client/session/link_monitor.h"
#include "client/session/map_choice.h"
#include "client/session/session_types.h"
#include "client/session/spool.h"
#include "common/map/relocalization_answer.h"
#include "common/wire/messages.h"

namespace cairn {

/// Events in, actions out: all that a session decides, without threads, transport, clock or chance. The frame
/// loop and the server's messages are its events; what is to be sent next, replies and the actions that
/// take_actions() gives are what comes of them. One thread at a time.
class SessionCore {
 public:
  /// `new_session`: never gives 0, and another id at each call.
  SessionCore(SessionOptions options, const CameraPtr& camera, std::function<SessionId()> new_session);

  /// What the events so far ask of the code that runs the core.
  struct Actions {
    struct Notice {
      enum class Level : uint8_t { kDebug, kInfo, kWarning } level;
      std::string text;
    };
    bool look_what_to_send = false;
    bool look_what_changed = false;  ///< link, decisions, snapshot: for those that wait
    std::vector<Notice> notices;     ///< for the log
  };
  [[nodiscard]] Actions take_actions() { return std::exchange(actions_, {}); }

  // The frame loop: see Session.
  void use_map(MapId map, Epoch epoch, Revision revision);
  void leave_map();
  void send_seed(SeedProposal proposal);
  void send_offer(SpooledOffer offer);
  void send_query(std::shared_ptr<const PlaceView> view, Timestamp time);
  void send_request(wire::ClientRequest request);
  void publish_state(const FrameResult& result, Timestamp time);
  [[nodiscard]] std::optional<SeedReply> take_seed_reply() { return std::exchange(seed_reply_, {}); }
  [[nodiscard]] std::vector<OfferReply> take_offer_replies() { return std::exchange(offer_replies_, {}); }
  [[nodiscard]] std::vector<RequestReply> take_request_replies() {
    return std::exchange(request_replies_, {});
  }
  [[nodiscard]] std::optional<RelocalizationAnswer> take_relocalization_answer() {
    return std::exchange(relocalization_answer_, {});
  }
  [[nodiscard]] std::optional<CameraUpdate> take_camera(const MapSnapshotPtr& snapshot);

  // What the server says.
  void take(const wire::ServerStatus& status);
  /// The server is there, or has gone, as the middleware sees it.
  void take_presence(bool is_alive);
  void take(const wire::MapInfo& listed);
  void take_unlisted(MapId map);
  void take(const wire::SeedVerdict& verdict);
  void take(const wire::OfferVerdict& verdict);
  void take(const wire::ClientReply& reply);
  void take(wire::RelocAnswer answer);
  void take(const wire::CameraEstimate& estimate);
  void take_forgotten(const wire::CameraEstimate& key);
  /// A whole revision of a map that is received. False: not yet, the values of our camera that it was made
  /// with have not come.
  [[nodiscard]] bool take(const MapSnapshotPtr& revision);
  void take_labels(MapId map, LabelListPtr labels) { maps_.set_labels(map, std::move(labels)); }

  // What is to be sent.
  /// Kinds of commands that the server reads.
  struct Readers {
    bool queries = false;
    bool seeds = false;
    bool offers = false;
    bool requests = false;
  };
  struct Offer {
    Spool::Sendable sendable;
    uint64_t reference = 0;  ///< the command of the offer that it is relative to; 0: none, or not known
  };
  using Outgoing = std::variant<wire::CameraMessage, wire::TrackerStateMessage, QuerySlot::Sendable,
                                SeedSlot::Sendable, Offer, RequestSpool::Sendable>;
  /// The next message to send, which counts as sent; nothing: none is to be sent now. After a camera,
  /// written() must follow.
  [[nodiscard]] std::optional<Outgoing> next(MonotonicTime now, const Readers& readers);
  /// When next() is to be asked again, if nothing happens before.
  [[nodiscard]] MonotonicTime next_due() const;
  /// The camera could be written, or could not. Commands wait for that, since they name it.
  void written(bool is_written) { camera_.written(is_written); }
  /// The session joins anew: what was announced to the middleware is forgotten.
  void joined_anew() { camera_.announce_again(); }

  [[nodiscard]] const SessionOptions& options() const { return options_; }
  [[nodiscard]] ClientId client() const { return tracker_.client; }
  [[nodiscard]] const MapChoice& maps() const { return maps_; }
  [[nodiscard]] ServerLink link() const { return monitor_.link(); }
  /// The status, without what the participant has sent and received.
  [[nodiscard]] SessionStatus status() const;
  /// Whether the server has said that it serves this process.
  [[nodiscard]] bool is_name_held() const { return name_held_; }
  /// Why the server does not serve us; empty: it does.
  [[nodiscard]] const std::string& refusal() const { return refusal_; }
  /// See Session.
  [[nodiscard]] KeyframeUse keyframe_use(MapId map) const;
  /// Whether the server in sight knows the map in use (or there is none).
  [[nodiscard]] bool is_map_known() const;
  /// Whether nothing is undecided or unanswered, and the revision that the last decision named is swapped in.
  [[nodiscard]] bool is_settled() const;

 private:
  void act_on(LinkMonitor::Event event);
  [[nodiscard]] std::string text_of_silence() const;
  void begin_anew();
  void choose_map(MapId map);
  [[nodiscard]] wire::TrackerStateMessage state_to_send() const;
  [[nodiscard]] std::optional<Outgoing> next_command(MonotonicTime now, const Readers& readers);
  /// Images leave this machine, and its user may not want that.
  void tell_of_proposals(MapId map);
  /// An offer goes out as this command. Returns the one that it is relative to, as Offer::reference.
  [[nodiscard]] uint64_t sent(const KeyframeProposal& proposal, uint64_t command);
  void say(Actions::Notice::Level level, std::string text) {
    actions_.notices.push_back({level, std::move(text)});
  }

  const SessionOptions options_;
  const std::function<SessionId()> new_session_;
  SessionId session_;
  Actions actions_;

  LinkMonitor monitor_;
  bool restarted_ = false;  ///< the server in sight is not the one that the map in use came from
  bool name_held_ = false;
  std::string refusal_;

  Spool spool_;
  std::map<uint64_t, uint64_t> commands_;  ///< by number of proposal: those sent last in this session
  SeedSlot seed_;
  std::optional<SeedReply> seed_reply_;
  std::vector<OfferReply> offer_replies_;
  QuerySlot query_;
  std::optional<RelocalizationAnswer> relocalization_answer_;
  RequestSpool requests_;
  std::vector<RequestReply> request_replies_;

  CameraNegotiation camera_;
  MapChoice maps_;
  MapId own_map_;  ///< made from our seed, before its first revision; none: there is nothing to expect

  /// The server's terms for a map.
  struct MapTerms {
    wire::MapRight right = wire::MapRight::kWrite;
    bool takes_proposals = false;
  };
  std::map<MapId, MapTerms> terms_;
  MapId proposed_to_;  ///< the map of the proposals that a person was told of last

  wire::TrackerStateMessage tracker_;  ///< to publish, complete but for the replica; `map`: of its pose
  bool tracker_changed_ = true;
  MonotonicTime state_sent_{};
};

}  // namespace cairn
