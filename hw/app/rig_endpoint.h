// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "common/base/log.h"
#include "common/base/rate_limit.h"
#include "common/wire/participant.h"
#include "common/wire/partition.h"
#include "common/wire/peers.h"
#include "common/wire/rig_messages.h"
#include "common/wire/topic.h"
#include "common/wire/waiter.h"

namespace cairn {

/// The rig's place in the network: it hands on the orders and the camera's poses that come, and writes
/// states. Who gives an order is known by the partition that it came in, which in a secured site nobody else
/// can write in. It has a thread of its own, so that the thread that has the bus never waits for the network.
/// An exception of a function that it calls is logged, and costs the one message that the call was for.
class RigEndpoint {
 public:
  using Handler = std::function<void(wire::RigCommand)>;
  using Watcher = std::function<void(const wire::TrackerStateMessage&)>;
  using Source = std::function<std::optional<wire::RigState>()>;
  using StateWatcher = std::function<void(const wire::RigState&)>;

  /// `options.role` is kRig. Errors: those of Participant::create().
  [[nodiscard]] static Result<std::unique_ptr<RigEndpoint>> create(const wire::ParticipantOptions& options,
                                                                   const std::string& rig);
  ~RigEndpoint();
  RigEndpoint(const RigEndpoint&) = delete;
  RigEndpoint& operator=(const RigEndpoint&) = delete;

  /// Starts the thread, which calls the functions until stop(). `told`, if any, gets each state after it was
  /// written.
  void start(Handler obey, Source take_state, Watcher see, StateWatcher told = {});
  /// There is a state to take. Thread-safe, before start() too.
  void wake() { waiter_.wake(); }
  /// Ends the thread: afterwards none of the functions is called.
  void stop();

 private:
  RigEndpoint(std::string rig, Logger log, wire::Participant participant,
              wire::Reader<wire::RigCommand> commands, wire::Reader<wire::TrackerStateMessage> poses,
              wire::Writer<wire::RigState> states, wire::Waiter waiter);
  void run();
  template <typename Message, typename Use>
  void take_from_speakers(wire::Reader<Message>& reader, const Use& use);
  void tell_state();
  template <typename Work>
  void guard(const Work& work);
  /// The one who speaks in a publication. Nothing: it has gone, or its partition names nobody who speaks to
  /// this rig.
  [[nodiscard]] std::optional<wire::RigSpeaker> speaker_of(const wire::ReaderBase& reader,
                                                           wire::PublicationHandle publication);

  const std::string rig_;
  const Logger log_;
  Handler obey_;  ///< and likewise, since start():
  Source take_state_;
  Watcher see_;
  StateWatcher told_;

  wire::Participant participant_;
  wire::Reader<wire::RigCommand> commands_;
  wire::Reader<wire::TrackerStateMessage> poses_;
  wire::Writer<wire::RigState> states_;
  wire::Waiter waiter_;
  std::map<wire::PublicationHandle, wire::RigSpeaker> speakers_;  ///< as the middleware was asked once
  RateLimit warning_;                                             ///< of the thread
  std::atomic<bool> ends_{false};
  std::thread thread_;
};

}  // namespace cairn
