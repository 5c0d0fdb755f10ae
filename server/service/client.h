// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "common/base/rate_limit.h"
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
  std::optional<DoubtfulCamera> doubt;  ///< nothing: its values are exact

  /// What the map makers want to know. `version`: which values of which client's camera these are.
  [[nodiscard]] std::optional<CameraDoubt> doubt_of(const CameraVersion& version) const;
};

/// Cameras as announced under a client's name, few per process. Each process has its own: one that is refused
/// the name announces its camera all the same. Used from one thread.
class CameraList {
 public:
  /// Takes a version of a camera; the one before stays for what is in flight. A version never changes. Error:
  /// why it cannot be used.
  Status put(wire::PeerId process, const wire::CameraMessage& message);
  /// `process` holds the name: its cameras are meant from now on.
  void set_holder(wire::PeerId process) { holder_ = process; }
  [[nodiscard]] bool is_holder(wire::PeerId process) const { return holder_ == process; }
  /// A camera of the holder's, until the next call of put(); null when it has not announced it (yet).
  [[nodiscard]] const AnnouncedCamera* find(uint32_t camera, uint32_t version) const;

 private:
  static constexpr size_t kMaxProcesses = 8;
  static constexpr size_t kMaxCameras = 8;
  static constexpr size_t kVersionsKept = 2;
  using Cameras = std::map<uint32_t, std::map<uint32_t, AnnouncedCamera>>;

  [[nodiscard]] Cameras& cameras_of(wire::PeerId process);

  std::deque<std::pair<wire::PeerId, Cameras>> processes_;  ///< in the order of their first announcement
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
  /// What it was told of its cameras: the latest epoch and version of each, by the map that finds it out.
  std::map<std::pair<MapId, uint32_t>, std::pair<Epoch, uint32_t>> cameras_told;
  std::optional<MonotonicTime> camera_missed_at;  ///< the first command whose camera is not known

  /// What its tracker said of itself last.
  struct Word {
    SessionId session;
    TrackingState state = TrackingState::kStarting;
    MapId map;
    float quality = 0;
    bool is_proven = false;  ///< it is found in the map, which is there
    MonotonicTime at;
  };
  std::optional<Word> last_word;
  std::optional<SessionId> kicked;  ///< the process that an operator has ended

  bool connected = false;     ///< it is told what there is
  std::set<MapId> maps_told;  ///< by MapInfo, while connected
  MonotonicTime left_at;      ///< when it was not any more
  std::optional<MonotonicTime> intruder_told_at;
  SessionId intruder;             ///< the latest: logged once, told again and again
  bool repeat_verdicts = false;   ///< an intruder's notice may have replaced ours
  RateLimit camera_warning{};     ///< a peer may announce what is refused as often as it likes
  bool lockstep_refused = false;  ///< its session asked for it here, where there is none
};

}  // namespace cairn
