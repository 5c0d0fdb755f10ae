// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "common/base/rate_limit.h"
#include "common/base/repeats.h"
#include "common/base/time.h"
#include "common/base/token_bucket.h"
#include "common/geometry/camera.h"
#include "common/geometry/camera_guess.h"
#include "common/wire/messages.h"
#include "common/wire/peers.h"
#include "server/access/principal.h"
#include "server/mapping/map_camera.h"
#include "server/service/client_rates.h"
#include "server/service/command_gate.h"
#include "server/service/pending_offers.h"

namespace cairn {

struct AnnouncedCamera {
  CameraPtr camera;
  std::optional<IntrinsicsPrior> prior;  ///< nothing: its values are exact

  /// The prior that map makers are told; nothing: the camera's values are exact. `version`: which values of
  /// which client's camera these are.
  [[nodiscard]] std::optional<CameraPrior> prior_of(const CameraVersion& version) const;
};

/// Cameras as announced under a client's name, few per process. Each process has its own: one that is refused
/// the name announces its camera all the same. Each has its own rate, too: what one announces too often does
/// not count against another, since a tracker announces its camera once, before it is known to hold the name.
/// Used from one thread.
class CameraList {
 public:
  /// Takes a version of a camera; the one before stays for what is in flight. A version never changes. Error:
  /// why it cannot be used.
  [[nodiscard]] Status put(wire::PeerId process, const wire::CameraMessage& message, MonotonicTime now);
  /// `process` holds the name: its cameras are meant from now on.
  void set_holder(wire::PeerId process) { holder_ = process; }
  /// A camera of the holder's, until the next call of put(); null when it has not announced it (yet).
  [[nodiscard]] const AnnouncedCamera* find(uint32_t camera, uint32_t version) const;

 private:
  static constexpr size_t kMaxProcesses = 8;
  static constexpr size_t kMaxCameras = 8;
  static constexpr size_t kVersionsKept = 2;
  // A map that self-calibrates a camera changes its values with each revision.
  static constexpr int kPerSecond = 30;  ///< in the long run
  static constexpr int kAtOnce = 300;
  static constexpr int kNewPerSecond = 2;  ///< processes: each may announce kAtOnce
  static constexpr int kNewAtOnce = 20;
  using Cameras = std::map<uint32_t, std::map<uint32_t, AnnouncedCamera>>;
  struct Process {
    wire::PeerId id;
    Cameras cameras;
    TokenBucket announcements{kPerSecond, kAtOnce};
  };

  /// The list of a process, a new one if it has none; null: too many processes come one after another.
  [[nodiscard]] Process* let_in(wire::PeerId process, MonotonicTime now);

  std::deque<Process> processes_;                     ///< in the order of their first announcement
  TokenBucket newcomers_{kNewPerSecond, kNewAtOnce};  ///< who is forgotten and comes again is one of them
  std::optional<wire::PeerId> holder_;
};

/// Why a process is not served at all: an outcome of sequence 0, which no offer has.
[[nodiscard]] wire::OfferOutcome notice_to_process(const std::string& reason);

/// Names remembered; those present are never forgotten.
inline constexpr size_t kMaxClients = 256;

/// What the server keeps of one client name. The gates outlive the connection: the same process may come back
/// with commands that were decided long ago.
struct Client {
  explicit Client(const RateLimits& limits) : rates(limits), others_rates(limits) {}
  std::string name;
  ClientId id;
  Principal::Proof proof = Principal::Proof::kClaimed;  ///< of the name, by whoever spoke under it last
  [[nodiscard]] Principal principal() const { return client_principal(name, proof); }
  OfferGate offer_gate;
  SeedGate seed_gate;
  RequestGate request_gate;
  PendingOffers pending_offers;
  ClientRates rates;         ///< of the process that holds the name
  ClientRates others_rates;  ///< of all others that say something under it
  bool seed_in_work = false;
  bool query_in_work = false;
  CameraList cameras;
  /// What it was told of its cameras: the latest epoch and version of each, by the map that calibrates it.
  std::map<std::pair<MapId, uint32_t>, std::pair<Epoch, uint32_t>> cameras_told;
  std::optional<MonotonicTime> camera_missed_at;  ///< the first command whose camera is not known

  /// What its tracker said of itself last.
  struct Word {
    SessionId session;
    TrackingState state = TrackingState::kStarting;
    MapId map;
    float quality = 0;
    bool is_verified = false;  ///< it is found in the map, which is there
    MonotonicTime at;
  };
  std::optional<Word> last_word;
  std::optional<SessionId> kicked;  ///< the process that an operator has ended

  bool connected = false;     ///< it is told what there is
  std::set<MapId> maps_told;  ///< by MapInfo, while connected
  MonotonicTime left_at;      ///< when it was not any more
  std::optional<MonotonicTime> intruder_told_at;
  SessionId intruder;            ///< the latest: logged once, told again and again
  bool repeat_verdicts = false;  ///< an intruder's notice may have replaced ours
  RateLimit camera_warning{};    ///< a peer may announce what is refused as often as it likes
  /// Counts for the audit log what it may not do and asks for all the same, as a tracker does with each
  /// keyframe.
  Repeats refused{std::chrono::hours(1)};
  Repeats seeds_refused{};        ///< for the server's log
  bool lockstep_refused = false;  ///< its session asked for it here, where there is none
};

}  // namespace cairn
