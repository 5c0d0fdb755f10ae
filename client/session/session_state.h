// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "client/session/link_monitor.h"
#include "client/session/session.h"
#include "client/session/spool.h"
#include "common/geometry/camera_guess.h"
#include "common/wire/messages.h"

namespace cairn {

constexpr size_t kMostRequests = 32;  ///< undecided, of a person
constexpr const char* kRestartedText = "server restarted without this map";

/// A revision that must be swapped in before a lockstep client goes on.
struct RequiredRevision {
  MapId map;
  Epoch epoch;
  Revision revision;
};

/// What the frame loop, the receiver and the sender of a session share. Everything is guarded by `mutex`,
/// which is held for moments only: never while encoding, writing, taking or building snapshots.
struct SessionState {
  SessionState(SessionOptions o, ClientId id, SessionId session)
      : options(std::move(o)),
        client(id),
        session_id(session),
        spool(options.spool_limit, session),
        seed(session),
        question(session),
        requests(kMostRequests, session) {
    tracker.client = id;
    tracker.wearer = options.wearer;
    camera.client = id;
  }

  const SessionOptions options;
  const ClientId client;

  mutable std::mutex mutex;
  std::condition_variable for_sender;   ///< something may be sent
  std::condition_variable for_waiters;  ///< link, decisions or snapshot changed
  bool stopping = false;                ///< receiver and sender are to end

  SessionId session_id;
  LinkMonitor monitor;
  bool restarted = false;  ///< the server in sight is not the one that the map in use came from
  bool name_held = false;  ///< the server has said that it serves this process
  std::string refusal;     ///< why the server does not serve us; empty: it does

  Spool spool;
  std::map<uint64_t, uint64_t> commands;  ///< by number of proposal: those sent last in this session
  SeedSlot seed;
  std::optional<SeedReply> seed_reply;
  std::vector<OfferReply> offer_replies;
  QuestionSlot question;
  std::optional<PlaceAnswer> place_answer;

  RequestSpool requests;
  std::vector<RequestReply> request_replies;

  wire::CameraMessage camera;  ///< as in use
  bool camera_due = true;      ///< to be announced
  /// How well it was known when the session began: DoubtfulCamera.
  double first_focal_sigma = 0;
  double first_k1_sigma = 0;
  CameraPtr first_camera;
  /// What a map has found out about the camera.
  struct FoundCamera {
    Epoch epoch;
    CameraNews news;
  };
  /// Estimates overtake revisions: so many are kept of each map, the newest last.
  static constexpr size_t kEstimatesKept = 8;
  std::map<MapId, std::deque<FoundCamera>> found_out;
  /// Where values come from: each map and epoch counts its own versions.
  struct CameraSource {
    MapId map;
    Epoch epoch;
    uint32_t version = 0;
    bool operator==(const CameraSource&) const = default;
  };
  std::optional<CameraSource> camera_source;  ///< of the values in use; nothing: as the session began
  std::set<MapId> unsound_cameras;            ///< maps whose latest word on our camera cannot be
  MapId own_map;  ///< made from our seed, before its first revision; none: there is nothing to expect

  wire::TrackerStateMessage tracker;  ///< to publish, complete but for the replica; `map`: of its pose
  bool tracker_changed = true;

  /// What the server says of a map.
  struct MapTerms {
    wire::MapRight right = wire::MapRight::kWrite;
    bool takes_proposals = false;
  };
  std::map<MapId, MapTerms> terms;
  MapId proposed_to;  ///< the map of the proposals that a person was told of last

  MapId map_in_use;
  std::deque<MapId> recent_maps;             ///< received; the one chosen last first
  std::map<MapId, MapSnapshotPtr> replicas;  ///< newest whole revisions of them
  std::map<MapId, LabelListPtr> labels;      ///< of them
  MapSnapshotPtr snapshot;  ///< of the map in use or, until its first revision is there, of the one before
  std::optional<RequiredRevision> required;

  /// An offer goes out as this command. Returns the one that it is relative to; 0: none, or it is not known.
  uint64_t sent(const KeyframeProposal& proposal, uint64_t command) {
    commands[proposal.number] = command;
    if (commands.size() > 2 * options.spool_limit) commands.erase(commands.begin());
    const auto reference = commands.find(proposal.reference_number);
    return proposal.reference_number == 0 || reference == commands.end() ? 0 : reference->second;
  }
  [[nodiscard]] KeyframeUse use_of_keyframes(MapId map) const {
    const auto known = terms.find(map);
    const MapTerms said = known == terms.end() ? MapTerms{} : known->second;
    if (!options.reads_only && said.right != wire::MapRight::kRead) return KeyframeUse::kKeyframe;
    if (said.takes_proposals) return options.proposes ? KeyframeUse::kProposal : KeyframeUse::kNothing;
    return options.reads_only ? KeyframeUse::kNothing : KeyframeUse::kKeyframe;
  }
  void choose_map(MapId map) {
    if (map_in_use == map) return;
    map_in_use = map;
    required.reset();
    restarted = false;
    if (!map) {
      snapshot = nullptr;
      return;
    }
    std::erase(recent_maps, map);
    recent_maps.push_front(map);
    if (recent_maps.size() > options.recent_maps) {
      replicas.erase(recent_maps.back());
      labels.erase(recent_maps.back());
      recent_maps.pop_back();
    }
    if (const MapSnapshotPtr replica = replica_in_use()) snapshot = replica;
  }
  /// Null before its first revision.
  [[nodiscard]] MapSnapshotPtr replica_in_use() const {
    const auto replica = replicas.find(map_in_use);
    return replica == replicas.end() ? nullptr : replica->second;
  }
  /// Our camera, as a revision names it; null when it names none of ours.
  [[nodiscard]] const CameraVersion* our_camera_in(const MapSnapshot& map) const {
    const auto named = std::find_if(map.cameras.begin(), map.cameras.end(), [&](const CameraVersion& v) {
      return v.client == client && v.camera == camera.camera;
    });
    return named == map.cameras.end() ? nullptr : &*named;
  }
  /// Which values of our camera a revision was made with; nothing when those in use are to be kept: it names
  /// none, or these, or ours are known already (found out elsewhere, or exact from the start).
  [[nodiscard]] std::optional<CameraSource> other_camera_of(const MapSnapshot& map) const {
    const CameraVersion* named = camera.frozen ? nullptr : our_camera_in(map);
    if (named == nullptr) return std::nullopt;
    const CameraSource source{map.map, map.epoch, named->version};
    return source == camera_source ? std::nullopt : std::optional(source);
  }
  /// The values that the revision was made with or, where those were overtaken, the next later ones of its
  /// map; null when they are not there yet.
  [[nodiscard]] const FoundCamera* find_camera(const CameraSource& source) const {
    const auto found = found_out.find(source.map);
    if (found == found_out.end()) return nullptr;
    const auto there =
        std::find_if(found->second.begin(), found->second.end(), [&](const FoundCamera& estimate) {
          return estimate.epoch > source.epoch ||
                 (estimate.epoch == source.epoch && estimate.news.version >= source.version);
        });
    return there == found->second.end() ? nullptr : &*there;
  }
  /// What is known of the camera before any map.
  [[nodiscard]] CameraNews first_guess() const {
    return {0, first_camera, first_focal_sigma, first_k1_sigma, false, false};
  }
  /// From now on; announces them. What a map believes so far, the next one would take for what was known
  /// before it: the sigma is that of the beginning until the camera is known.
  CameraNews use_camera(const std::optional<CameraSource>& source, CameraNews news) {
    camera_source = source;
    ++camera.version;
    camera.parameters = news.camera->parameters();
    camera.sigma = sigma_of_values({camera.parameters, news.frozen ? news.focal_sigma : first_focal_sigma,
                                    news.frozen ? news.k1_sigma : first_k1_sigma});
    camera.frozen = news.frozen;
    camera_due = true;
    for_sender.notify_one();
    return news;
  }
  /// Whether a revision can be tracked on: what it was made with is in use, or there to be used.
  [[nodiscard]] bool has_camera_of(const MapSnapshot& map) const {
    const auto other = other_camera_of(map);
    return !other || find_camera(*other) != nullptr;
  }
  /// A revision is to be waited for, unless a later one of its map is or another map is in use: the server
  /// tells its latest verdict on offers again with each one on a seed, and what that asks for is over.
  void require(const RequiredRevision& wanted) {
    if (wanted.map != map_in_use) return;
    const bool is_later = !required || required->map != wanted.map || required->epoch < wanted.epoch ||
                          (required->epoch == wanted.epoch && required->revision < wanted.revision);
    if (is_later) required = wanted;
  }
  /// Whether `required` is swapped in.
  [[nodiscard]] bool is_current() const {
    if (!required || required->map != map_in_use) return true;
    const MapSnapshotPtr replica = replica_in_use();
    if (replica == nullptr || replica->epoch != required->epoch)
      return replica && replica->epoch > required->epoch;
    return replica->revision >= required->revision;
  }
  /// Whether the server in sight knows the map in use (or there is none).
  [[nodiscard]] bool is_map_known() const { return !map_in_use || !restarted || monitor.knows(map_in_use); }
};

}  // namespace cairn
