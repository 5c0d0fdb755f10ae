// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/geometry/up_direction.h"
#include "common/image/image.h"
#include "common/image/place.h"
#include "common/map/ids.h"
#include "common/map/label.h"
#include "common/map/limits.h"
#include "common/map/observations.h"
#include "common/map/relocalization_answer.h"
#include "common/map/snapshot.h"
#include "common/wire/limits.h"

/// What travels, as value types: one struct per topic of idl/README.md. Conversion to and from the generated
/// DDS structs, and validation of everything a peer sends (finite numbers, sizes, enums, unit quaternions),
/// is inside common/wire.
namespace cairn::wire {

/// A command's place in a client's stream of one topic: de-duplicated by (client, topic, session, seq).
struct CommandId {
  SessionId session;
  uint64_t seq = 0;  ///< from 1, no gaps
  auto operator<=>(const CommandId&) const = default;
};

// ---- client -> server

/// Topic Camera: claim, keyed by (client, camera).
struct CameraMessage {
  ClientId client;
  uint32_t camera = 0;
  uint32_t version = 1;
  CameraParameters parameters;
  std::vector<double> sigma;  ///< of each parameter; empty = taken as exact
  bool frozen = true;
};

enum class ImageEncoding : uint8_t { kRaw = 0, kJpeg = 1, kLast = kJpeg };

/// A grey keyframe image; encoded where the link is slow.
struct ImageMessage {
  ImageEncoding encoding = ImageEncoding::kRaw;
  uint32_t width = 0;
  uint32_t height = 0;
  std::vector<uint8_t> bytes;  ///< raw: width * height, no padding
};

/// Topic MapSeed: command.
struct MapSeed {
  ClientId client;
  CommandId command;
  uint32_t camera = 0;
  uint32_t camera_version = 1;
  bool lockstep = false;
  Timestamp first_time;
  Timestamp second_time;
  ImageMessage first_image;
  ImageMessage second_image;
  std::vector<Trail> trails;  ///< at most kMaxTrails
  SE3 second_from_first;  ///< |translation| = 1; the server checks it on the images, and searches no other
  std::string map_name;   ///< wished for; empty = the server names it
  /// What stands still in the camera's images (StillMask): a bit for each cell, row by row, the lowest bit of
  /// a byte first. Empty: nothing does.
  std::vector<uint8_t> still_mask;
  std::optional<UpDirection> second_up;  ///< in the axes of the second view; nothing: not known
};

/// Topic KeyframeOffer: command. The pose is relative to a keyframe, so it survives adjustments on the way.
struct KeyframeOffer {
  ClientId client;
  CommandId command;
  MapId map;
  Epoch epoch;
  Revision revision;  ///< of the replica that the frame was tracked on
  KeyframeId reference;
  SE3 camera_from_reference;  ///< this camera from the reference keyframe's camera
  uint32_t camera = 0;
  uint32_t camera_version = 1;
  bool lockstep = false;
  Timestamp time;
  ImageMessage image;
  std::vector<PointMeasurement> measurements;  ///< at most kMaxMeasurements
  std::vector<PointCandidate> candidates;      ///< at most kMaxCandidates
  /// 0: `reference` is a keyframe of the map. Else the number of an earlier offer of this session, and the
  /// keyframe that came of it is meant.
  uint64_t reference_command = 0;
  std::vector<uint8_t> still_mask;  ///< as MapSeed's
  std::optional<UpDirection> up;    ///< in the camera's axes; nothing: not known
  bool as_proposal = false;         ///< to be kept aside at most: the client changes no map
};

/// Topic RelocQuery: claimed query, keyed by client. A newer one replaces one that has not been taken.
struct RelocQuery {
  ClientId client;
  CommandId command;
  MapId map_hint;  ///< in which the tracker was last; none: nowhere yet
  uint32_t camera = 0;
  uint32_t camera_version = 1;
  bool lockstep = false;
  Timestamp time;
  ImageMessage small_image;          ///< raw; pyramid level 3 of the frame
  std::vector<PlaceCorner> corners;  ///< at most kMaxPlaceCorners
  std::optional<UpDirection> up;     ///< as KeyframeOffer's
};

enum class RequestAction : uint8_t {
  kAddLabel = 0,
  kRenameLabel = 1,  ///< another text
  kRemoveLabel = 2,
  kLast = kRemoveLabel,
};

/// Topic ClientRequest: command. What a person in front of a viewer asks for.
struct ClientRequest {
  ClientId client;
  CommandId command;
  RequestAction action = RequestAction::kAddLabel;
  MapId map;
  LabelId label;                      ///< to be renamed or removed
  LabelKind kind = LabelKind::kText;  ///< of one to be added
  std::string text;                   ///< at most kMaxLabelBytes
  /// The place where the label is added, relative to a keyframe, so that it survives adjustments on the way.
  Epoch epoch;
  KeyframeId reference;
  SE3 reference_from_label;  ///< the keyframe's camera from the label
};

/// Topic TrackerState: presence, liveliness 3 s.
struct TrackerStateMessage {
  ClientId client;
  SessionId session;
  TrackingState state = TrackingState::kStarting;
  MapId map;  ///< none while starting
  Epoch epoch;
  Revision revision;  ///< of the replica in use
  SE3 camera_from_map;
  float quality = 0;  ///< found / (attempted - hidden), 0..1
  Timestamp frame_time;
  std::string wearer;  ///< who wears the camera, as the tracker claims; empty: nobody in particular
};

// ---- server -> client

/// Topic ServerStatus: status, liveliness MANUAL_BY_TOPIC 1 s (asserted by every write).
struct ServerStatus {
  ServerId server;           ///< new with every start of a server without a store
  uint64_t start_count = 0;  ///< epoch of the server
  std::string version;
  std::string health;  ///< "ok" or what is wrong
  uint32_t clients = 0;
  uint32_t maps = 0;
  float load = 0;  ///< busy share of the worker pool, 0..1
};

enum class MapRight : uint8_t { kNone = 0, kRead = 1, kWrite = 2, kLast = kWrite };

/// Topic MapInfo: state, keyed by map; disposed when the map goes.
struct MapInfo {
  MapId map;
  std::string name;
  Epoch epoch;
  Revision revision;
  uint32_t keyframes = 0;
  uint32_t points = 0;
  Eigen::Vector3f bounds_min = Eigen::Vector3f::Zero();
  Eigen::Vector3f bounds_max = Eigen::Vector3f::Zero();
  bool plane_aligned = false;  ///< Z = 0 is the dominant plane
  bool metric = false;
  MapRight right = MapRight::kWrite;
  ServerId server;  ///< who lists it: what a server lists is nothing to its successor
  /// Keyframes of this client that do not become part of the map are kept aside for the operator.
  bool takes_proposals = false;
};

/// A block and the least version of it that belongs to a revision.
struct BlockVersion {
  uint32_t index = 0;
  uint64_t patches = 0;
  uint64_t positions = 0;
};

/// Topic PointPatches / PointPositions / KeyframePoses: state, keyed by (map, block), in the partition of one
/// client and map.
struct PointPatches {
  MapId map;
  Epoch epoch;
  PatchBlock block;
};
struct PointPositions {
  MapId map;
  Epoch epoch;
  PositionBlock block;
};
struct KeyframePoses {
  MapId map;
  Epoch epoch;
  KeyframeBlock block;
};

/// Topic MapCommit: state, keyed by map. Ends the burst of a revision.
struct MapCommit {
  MapId map;
  std::string name;
  Epoch epoch;
  Revision revision;
  bool metric = false;
  std::vector<BlockVersion> points;         ///< every block of the revision, by index
  std::vector<uint64_t> keyframe_versions;  ///< of keyframe block 0, 1, ...
  std::vector<CameraVersion> cameras;       ///< MapSnapshot::cameras
};

/// Topic CameraEstimate: state, keyed by (client, camera, map); disposed when the map goes. What a map has
/// found in self-calibration of a camera that was announced with sigmas. Written before the revisions that
/// name it.
struct CameraEstimate {
  ClientId client;
  uint32_t camera = 0;
  MapId map;
  Epoch epoch;           ///< of the map
  uint32_t version = 1;  ///< in this map and epoch, as its revisions name it: no sequence with any other
  CameraParameters parameters;
  std::vector<double> sigma;     ///< of each parameter; 0: not calibrated
  bool frozen = false;           ///< known well enough: will not change any more
  bool cannot_be_known = false;  ///< the motion so far does not tell the focal length
};

/// Topic SeedVerdict: state, keyed by client.
struct SeedVerdict {
  ClientId client;
  CommandId command;  ///< of the seed judged
  bool accepted = false;
  std::string reason;  ///< of a refusal, for a person
  MapId map;
  Epoch epoch;
  Revision revision;  ///< first revision of the map
  KeyframeId first_keyframe;
  KeyframeId second_keyframe;
  std::vector<std::pair<TrailId, PointId>> points;
};

enum class OfferDecision : uint8_t {
  kAccepted = 0,
  kTooClose = 1,      ///< a keyframe is there already
  kTooFewPoints = 2,  ///< not enough of its measurements agree with the map
  kStale = 3,         ///< its epoch or reference keyframe is gone
  kNoRight = 4,
  kUnknownMap = 5,  ///< e.g. the server restarted without it
  kDamaged = 6,     ///< image or numbers unusable
  kBusy = 7,        ///< more offers in flight than the credit allows
  kFull = 8,        ///< the map has all the points it may have, or the server all the memory
  kKeptAside = 9,   ///< no keyframe, but kept as a proposal, of which the operator decides
  kLast = kKeptAside,
};

struct OfferOutcome {
  uint64_t seq = 0;
  OfferDecision decision = OfferDecision::kAccepted;
  std::string reason;
  MapId map;
  KeyframeId keyframe;  ///< when accepted
  Epoch epoch;
  Revision revision;  ///< lockstep: to be swapped in before the next frame; otherwise the newest
};

/// Topic OfferVerdict: state, keyed by client.
struct OfferVerdict {
  ClientId client;
  SessionId session;
  uint64_t last_decided = 0;         ///< every seq up to here has been decided
  uint32_t credit = 0;               ///< offers that may be in flight beyond last_decided
  std::vector<OfferOutcome> recent;  ///< the last, at most kMaxOutcomes
};

enum class RequestDecision : uint8_t {
  kDone = 0,
  kUnfit = 1,  ///< e.g. no text
  kNoRight = 2,
  kUnknownMap = 3,
  kUnknownLabel = 4,
  kStale = 5,  ///< what the place was relative to is gone: to be pointed at again
  kFull = 6,   ///< the map has all the labels it may have, or nothing can be kept
  kBusy = 7,   ///< more requests in flight than the credit allows
  kLast = kBusy,
};

struct RequestOutcome {
  uint64_t seq = 0;
  RequestDecision decision = RequestDecision::kDone;
  std::string reason;
  MapId map;
  LabelId label;  ///< added, renamed or removed
};

/// Topic ClientReply: state, keyed by client.
struct ClientReply {
  ClientId client;
  SessionId session;
  uint64_t last_decided = 0;           ///< every seq up to here has been decided
  uint32_t credit = 0;                 ///< requests that may be in flight beyond last_decided
  std::vector<RequestOutcome> recent;  ///< the last, at most kMaxOutcomes
};

/// Topic Label: state, keyed by (map, label), in the partition of one client and map; disposed when the label
/// is removed. The pose is that in the newest revision: it is sent again when an adjustment has moved it.
struct LabelMessage {
  MapId map;
  Epoch epoch;
  Label label;
};

/// Topic RelocAnswer: query, keyed by client.
struct RelocAnswer {
  ClientId client;
  CommandId command;            ///< of the query answered
  RelocalizationAnswer answer;  ///< at most kMaxPlaceCandidates
};

// ---- operator <-> server

/// Topic AdminRequest: command, in the operator's partition.
struct AdminRequest {
  ClientId operator_id;
  CommandId command;
  std::string request;        ///< JSON: {"verb": ..., arguments}; the verbs: server/admin/README.md
  std::vector<uint8_t> data;  ///< a piece of an archive
};

/// Topic AdminReply: state, keyed by operator. A request that comes again is answered again, not done again.
struct AdminReply {
  ClientId operator_id;
  CommandId command;   ///< of the request
  uint8_t result = 0;  ///< exit code as in client/app/README.md
  std::string text;    ///< JSON, or why not
  std::vector<uint8_t> data;
};

/// [bytes] Longest piece of an archive in a request or a reply of an operator.
constexpr size_t kMaxAdminData = 60'000;
/// [bytes] Longest JSON in either of them: a long list comes in several replies.
constexpr size_t kMaxAdminText = 60'000;

}  // namespace cairn::wire
