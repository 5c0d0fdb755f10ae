// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <thread>

#include "client/session/session_state.h"
#include "common/base/log.h"
#include "common/base/rate_limit.h"
#include "common/wire/participant.h"
#include "common/wire/topic.h"

namespace cairn {

/// A session's outgoing half, with its own thread: the camera, the tracker's state (at most 60 times a
/// second, at least five times), seeds, offers and questions. Images are encoded here, off the frame loop.
class Sender {
 public:
  [[nodiscard]] static Result<std::unique_ptr<Sender>> start(SessionState& state,
                                                             const wire::Participant& participant,
                                                             const std::string& partition,
                                                             wire::ImageEncoding encoding, Logger log);
  /// Set state.stopping and notify state.for_sender before.
  ~Sender();
  Sender(const Sender&) = delete;
  Sender& operator=(const Sender&) = delete;

 private:
  struct Writers {
    wire::Writer<wire::CameraMessage> camera;
    wire::Writer<wire::TrackerStateMessage> tracker;
    wire::Writer<wire::MapSeed> seeds;
    wire::Writer<wire::KeyframeOffer> offers;
    wire::Writer<wire::RelocQuery> questions;
    wire::Writer<wire::ClientRequest> requests;
  };
  Sender(SessionState& state, Writers writers, wire::ImageEncoding encoding, Logger log);

  void run();
  void send_camera(std::unique_lock<std::mutex>& lock);
  void send_tracker_state(std::unique_lock<std::mutex>& lock, MonotonicTime now);
  void send_commands(std::unique_lock<std::mutex>& lock, MonotonicTime now);
  [[nodiscard]] wire::MapSeed make_message(const SeedSlot::Sendable& sendable) const;
  [[nodiscard]] wire::KeyframeOffer make_message(const Spool::Sendable& sendable, uint64_t reference) const;
  [[nodiscard]] wire::RelocQuery make_message(const QuestionSlot::Sendable& sendable) const;
  [[nodiscard]] wire::ClientRequest make_message(const RequestSpool::Sendable& sendable) const;
  void tell_of_proposals(MapId map);
  void report(const Status& written, const char* what);

  SessionState& state_;
  Writers writers_;
  wire::ImageEncoding encoding_;
  Logger log_;
  RateLimit warning_;
  MonotonicTime state_sent_{};
  wire::CameraMessage camera_;  ///< announced last: what commands name
  std::thread thread_;
};

}  // namespace cairn
