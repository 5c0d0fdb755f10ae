// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "client/tracking/frame_result.h"
#include "common/base/result.h"
#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/map/ids.h"
#include "common/wire/participant.h"

/// Options of a session, and the values in which it speaks to the frame loop.
namespace cairn {

struct SessionOptions {
  std::string server = "localhost";
  int domain = 0;
  std::string profile;   ///< empty: loopback for localhost, wifi otherwise
  std::string listen;    ///< interface or address of this machine; empty: that of the way to the server
  std::string security;  ///< folder of the client's keys (common/wire/security.h); empty: an open site
  std::string name;      ///< [a-z0-9-]{1,32}; of a secured site: that of the keys
  std::string wearer;    ///< who wears the camera, [a-z0-9-]{1,32}; empty: nobody in particular
  bool lockstep = false;
  size_t spool_limit = 256;  ///< undecided offers kept; when full the oldest unsent one is dropped and logged
  size_t recent_maps = 4;    ///< received at the same time: switching back to one of them takes no time
  bool reads_only = false;   ///< asks for no change of a map
  bool proposes = true;      ///< lets the server keep keyframes aside where they are no part of a map
  std::string only_map;      ///< the name of the one map to be used; empty: any
  /// The sigma of each value of the camera's parameters, which is calibrated by the maps that it helps to
  /// make. Empty: the values are exact.
  std::vector<double> prior_sigma;
  int xmit_loss_permille = 0;  ///< Cyclone's loss injection, for tests
  /// In tests, finds the way to a silent server; empty: wire::find_path().
  std::function<Result<wire::NetworkPath>(const wire::ParticipantOptions&)> find_path;
  /// In tests, joins the domain; empty: wire::Participant::create().
  std::function<Result<wire::Participant>(const wire::ParticipantOptions&)> join;
};

enum class ServerLink : uint8_t { kConnecting, kConnected, kGone, kRestarted, kRefused };

/// The state of a session, with words for the status line.
struct SessionStatus {
  ServerLink link = ServerLink::kConnecting;
  /// "connected to ...", "server gone: tracking on the replica", "server restarted without this map", or why
  /// it refuses us
  std::string text;
  bool map_known = true;       ///< whether the server knows the map in use
  bool waits_for_map = false;  ///< the server has the map in use, whose first revision is on its way
  size_t spooled = 0;
  uint64_t bytes_sent = 0;
  uint64_t bytes_received = 0;
};

/// The values that self-calibration in the server's maps gives our camera.
struct CameraUpdate {
  uint32_t version = 0;
  CameraPtr camera;
  double focal_sigma = 0;  ///< relative to the focal length
  double k1_sigma = 0;
  bool frozen = false;           ///< known well enough: will not change any more
  bool cannot_be_known = false;  ///< the motion so far does not tell the focal length
};

/// "focal length 531.2 px +- 0.8 %, k1 -0.012 +- 0.005"
[[nodiscard]] std::string describe(const CameraUpdate& update);

/// The server's answer to the latest seed.
struct SeedReply {
  std::optional<SeedAnswer> answer;  ///< nothing: refused
  std::string reason;
};

struct OfferReply {
  uint64_t seq = 0;
  bool accepted = false;
  std::string reason;
  KeyframeId keyframe = {};  ///< what it has become
  Timestamp time = {};       ///< of the frame
  uint64_t number = 0;       ///< of the proposal
  bool kept_aside = false;   ///< not accepted, but kept for the operator, as the reason says
};

/// What a map makes of a keyframe that is offered to it.
enum class KeyframeUse : uint8_t {
  kNothing,   ///< none is to be offered
  kProposal,  ///< it is kept aside for an operator
  kKeyframe,  ///< the map maker judges it, or the server says why it does not
};

/// The server's word on something that was asked for.
struct RequestReply {
  uint64_t seq = 0;
  bool done = false;
  std::string reason;  ///< of a refusal, for a person
  MapId map;
  LabelId label;  ///< added, renamed or removed
};

}  // namespace cairn
