// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <thread>

#include "client/session/session_messages.h"
#include "client/session/shared_core.h"
#include "common/base/log.h"
#include "common/base/rate_limit.h"
#include "common/wire/participant.h"
#include "common/wire/topic.h"

namespace cairn {

/// A session's outgoing half, with its own thread: it writes what SessionCore::next() gives. Images are
/// encoded here, off the frame loop.
class Sender {
 public:
  [[nodiscard]] static Result<std::unique_ptr<Sender>> start(SharedCore& core,
                                                             const wire::Participant& participant,
                                                             const std::string& partition,
                                                             wire::ImageEncoding encoding, Logger log);
  /// Stop the core before.
  ~Sender();
  Sender(const Sender&) = delete;
  Sender& operator=(const Sender&) = delete;

 private:
  struct Writers {
    wire::Writer<wire::CameraMessage> camera;
    wire::Writer<wire::TrackerStateMessage> tracker;
    wire::Writer<wire::MapSeed> seeds;
    wire::Writer<wire::KeyframeOffer> offers;
    wire::Writer<wire::RelocQuery> queries;
    wire::Writer<wire::ClientRequest> requests;
  };
  Sender(SharedCore& core, Writers writers, CommandHeader header, Logger log);

  void run();
  [[nodiscard]] SessionCore::Readers readers() const;
  void write(const SessionCore::Outgoing& outgoing);
  void write_camera(const wire::CameraMessage& camera);
  void report(const Status& written, const char* what);

  SharedCore& core_;
  Writers writers_;
  CommandHeader header_;
  Logger log_;
  RateLimit warning_;
  std::thread thread_;
};

}  // namespace cairn
