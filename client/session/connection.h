// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "client/session/path_watch.h"
#include "client/session/receiver.h"
#include "client/session/sender.h"
#include "client/session/shared_core.h"
#include "common/base/log.h"
#include "common/base/rate_limit.h"
#include "common/wire/participant.h"

namespace cairn {

/// A session's place in the DDS domain: participant, receiver and sender. A thread of its own watches, while
/// the server is silent, whether the way to it is another one now, and then makes all three anew; what the
/// session has and knows stays in SessionCore and ReceiverMemory. Thread-safe.
class Connection {
 public:
  /// Finds the network path that a participant with these options would take: wire::find_path(), or what
  /// stands in for it in tests.
  using FindPath = std::function<Result<wire::NetworkPath>(const wire::ParticipantOptions&)>;
  /// wire::Participant::create(), or what stands in for it in tests.
  using Join = std::function<Result<wire::Participant>(const wire::ParticipantOptions&)>;
  struct Network {
    FindPath find_path;
    Join join;
  };

  /// Joins; does not wait for the server. `core` outlives it.
  [[nodiscard]] static Result<std::unique_ptr<Connection>> open(SharedCore& core,
                                                                const wire::ParticipantOptions& options,
                                                                wire::ImageEncoding encoding, Network network,
                                                                Logger log);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  /// The map in use is another one.
  void map_changed();
  /// The traffic of all participants so far.
  [[nodiscard]] wire::Traffic traffic() const;
  [[nodiscard]] wire::NetworkPath path() const;

 private:
  /// What is made anew with each joining, in order of construction: the threads go first, the participant
  /// last. Where a link is left half made, by an exception too, its threads are told to end before they are
  /// waited for.
  struct Link {
    SharedCore& core;
    wire::Participant participant;
    std::unique_ptr<Receiver> receiver;
    std::unique_ptr<Sender> sender;

    ~Link() { core.stop(true); }
  };

  Connection(SharedCore& core, wire::ParticipantOptions options, wire::ImageEncoding encoding,
             Network network, Logger log);

  [[nodiscard]] Result<std::unique_ptr<Link>> make_link();
  void take_down();
  void join_anew();
  void watch();
  void look_for_a_way();
  [[nodiscard]] bool is_silent() const;
  /// Whether the folder of a secured site has keys that are good for longer than those we joined with.
  [[nodiscard]] bool has_newer_keys();

  SharedCore& core_;
  const wire::ParticipantOptions options_;
  std::string keys_trouble_;  ///< as told; of the thread that watches
  const wire::ImageEncoding encoding_;
  const Network network_;
  const Logger log_;
  ReceiverMemory memory_;

  mutable std::mutex mutex_;  ///< of what follows; never held while DDS entities are made or closed
  std::condition_variable for_watch_;
  bool closing_ = false;
  std::unique_ptr<Link> link_;  ///< null: while it is made anew, and until that succeeds
  wire::Traffic past_traffic_;
  wire::NetworkPath path_;  ///< the last one joined on

  std::unique_ptr<PathWatch> path_watch_;  ///< of the thread
  RateLimit warning_;                      ///< of the thread
  std::thread thread_;
};

}  // namespace cairn
