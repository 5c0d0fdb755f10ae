// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/session/session_types.h"
#include "client/tracking/frame_result.h"
#include "common/base/log.h"
#include "common/base/result.h"
#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/image/image.h"
#include "common/image/place.h"
#include "common/map/label.h"
#include "common/map/relocalization_answer.h"
#include "common/map/snapshot.h"
#include "common/wire/messages.h"
#include "common/wire/participant.h"

/// A client's side of the service: replicas of maps, seeds and keyframe offers with a spool, the server's
/// verdicts. All DDS work is done by the session's own threads; the frame loop's calls never wait (short
/// mutex or atomic pointer).
namespace cairn {

class Session {
 public:
  /// Joins the domain and announces the camera; does not wait for the server. While that is silent, the
  /// session looks whether its name or this machine has got another address, and then joins anew.
  [[nodiscard]] static Result<std::unique_ptr<Session>> open(const SessionOptions& options,
                                                             const CameraPtr& camera, Logger log);
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  /// Newest whole revision of the map in use (the one seeded, or chosen by use_map) or, before its first, of
  /// the map that was in use before; null without any.
  [[nodiscard]] MapSnapshotPtr snapshot() const;
  /// Makes a map of the server's the one in use; its replica comes, or is there if it was in use of late. In
  /// lockstep settling waits for the revision.
  void use_map(MapId map, Epoch epoch = {}, Revision revision = {});
  /// Forgets the map in use, e.g. to begin another, the seed and the query under way and their answers.
  void leave_map();

  /// The use of keyframes that are offered to a map, as far as the server has said what we may do in it.
  [[nodiscard]] KeyframeUse keyframe_use(MapId map) const;

  void send_seed(SeedProposal proposal);
  void send_offer(KeyframeProposal proposal, GrayImagePtr image, Timestamp time);
  /// Asks where the frame was taken; an unanswered earlier query is superseded. Dropped while there is no
  /// server.
  void send_query(std::shared_ptr<const PlaceView> view, Timestamp time);
  void publish_state(const FrameResult& result, Timestamp time);

  /// Labels of a map that was in use of late, in the epoch of its replica; null without any.
  [[nodiscard]] LabelListPtr labels(MapId map) const;
  /// Asks for a label to be added, renamed or removed (client and command are filled in); kept until the
  /// server has decided. Who only reads is refused at once.
  void send_request(wire::ClientRequest request);
  [[nodiscard]] std::vector<RequestReply> take_request_replies();

  [[nodiscard]] std::optional<SeedReply> take_seed_reply();
  [[nodiscard]] std::vector<OfferReply> take_offer_replies();
  [[nodiscard]] std::optional<RelocalizationAnswer> take_relocalization_answer();
  /// The values of our camera that go with this snapshot, when they are others than before: to be tracked
  /// with from now on. What is sent from now on names them. Null, after leave_map(): those that the session
  /// began with, unless the camera is known by now; what a map merely believed is not handed on to the next,
  /// whose prior would wander from map to map.
  [[nodiscard]] std::optional<CameraUpdate> take_camera(const MapSnapshotPtr& snapshot);
  [[nodiscard]] SessionStatus status() const;
  /// The way to the server that is in use: wire::way_to().
  [[nodiscard]] std::string network() const;

  /// Waits until the server is seen (false on time-out). For start-up and tests, not for the frame loop.
  [[nodiscard]] bool wait_for_server(std::chrono::milliseconds timeout);
  /// Waits until the server serves this process under its name (false on time-out): it refuses one whose
  /// predecessor has just crashed, or lives. For start-up and tests.
  [[nodiscard]] bool wait_for_name(std::chrono::milliseconds timeout);
  /// Waits until a whole revision of the map in use is there (false on time-out). For start-up and tests.
  [[nodiscard]] bool wait_for_map(std::chrono::milliseconds timeout);
  /// Lockstep: waits until every command sent is decided, every query answered, and the revision named
  /// by the decision is swapped in. False when the server was lost or began to refuse us meanwhile, or on
  /// time-out.
  [[nodiscard]] bool wait_until_settled(std::chrono::milliseconds timeout);

 private:
  struct State;
  explicit Session(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace cairn
