// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "common/base/result.h"
#include "common/base/time.h"
#include "common/map/label.h"
#include "common/wire/rig_messages.h"
#include "server/access/rights.h"
#include "server/mapping/expected_points.h"
#include "server/store/map_file.h"
#include "server/store/site_file.h"
#include "server/store/store.h"
#include "server/store/store_check.h"

/// What operators are answered, as values: admin_reply.h makes JSON of them for the wire.
namespace cairn {

namespace told {

struct Nothing {};  ///< it is done
struct Done {
  std::string what;       ///< for a person
  std::string note = {};  ///< what may not be as it was meant, for a person; may be empty
};

// Of the server.
struct DamagedSeen {
  DamagedFile file;
  bool served = false;  ///< what could be saved of it is
};
struct Server {
  ServerId server;
  std::string version;
  uint64_t start_count = 0;
  std::string health;
  std::filesystem::path store;  ///< empty: nothing is kept
  size_t maps = 0;
  size_t idle_maps = 0;
  size_t memory_bytes = 0;
  size_t max_maps = 0;
  size_t max_memory_bytes = 0;
  std::chrono::seconds idle_after{0};
  std::vector<DamagedSeen> damaged;   ///< the first of them
  size_t damaged_files = 0;           ///< how many there are
  std::vector<UnloadedMap> unloaded;  ///< the first of them
  size_t unloaded_maps = 0;           ///< how many there are
  std::vector<std::string> clients;
  std::map<std::string, std::string> wearers;  ///< of clients
};
struct RigSeen {
  wire::RigState state;
  bool silent = false;
  std::chrono::nanoseconds heard_ago{0};
};
struct Rigs {
  std::vector<RigSeen> rigs;
};
struct ClientSeen {
  struct Known {
    bool connected = false;
    bool proven = false;
    std::string wearer;  ///< empty: none
  };
  struct Tracker {
    TrackingState state = TrackingState::kStarting;
    float quality = 0;
    std::optional<std::string> map;  ///< its name
  };
  std::string name;
  bool blocked = false;
  bool revoked = false;            ///< its keys were
  std::optional<Known> known;      ///< nothing: it has not been here since the start
  std::optional<Tracker> tracker;  ///< nothing: it says nothing of itself
};
struct Clients {
  std::vector<ClientSeen> clients;
};

// Of maps.
struct OverlapSeen {
  std::string map;  ///< the neighbour's name
  MapId id;
  size_t keyframes = 0;
  size_t its_keyframes = 0;
  Timestamp found;
};
/// A map: its name, its size and its state.
struct Map {
  MapId id;
  std::string name;
  size_t keyframes = 0;
  size_t points = 0;
  Epoch epoch;
  Revision revision;
  size_t memory_bytes = 0;
  bool is_idle = false;
  bool plane_aligned = false;
  std::string failed;  ///< why its work has ended, and it takes nothing until the server starts again; empty:
                       ///< it works
};
/// A map, and what goes on in it.
struct BusyMap {
  Map map;
  std::string frozen;  ///< by whom and why; empty: it is not
  Eigen::Vector3f bounds_min = Eigen::Vector3f::Zero();
  Eigen::Vector3f bounds_max = Eigen::Vector3f::Zero();
  size_t clients = 0;
  std::optional<Timestamp> localized;
  uint64_t offers_accepted = 0;
  std::optional<double> offer_p50_ms;
  std::optional<double> offer_p95_ms;
  std::vector<OverlapSeen> overlaps;
};
/// A map, with measures that take a look at all of it.
struct WholeMap {
  struct Measures {
    double reprojection_px = 0;
    std::vector<std::pair<CameraParameters, size_t>> cameras;  ///< and how many keyframes each took
  };
  BusyMap map;
  size_t labels = 0;
  std::optional<Measures> measures;  ///< nothing: the map is made elsewhere
};
/// A page begins where it was asked to. What does not fit is left out, in this order.
struct Maps {
  std::vector<BusyMap> maps;
  std::vector<DeletedMap> deleted;
  std::vector<DamagedSeen> damaged;
  std::vector<UnloadedMap> unloaded;
};
struct GoneMap {
  MapId map;
};

// Of archives and of copies of the store's files.
struct Copy {
  std::string token;
  uint64_t bytes = 0;
};
struct Archive {
  Copy copy;
  std::string name;
  MapId map;
};
struct Piece {
  std::vector<uint8_t> data;
};

// Of the store's files.
struct Parts {
  std::vector<std::string> parts;
};
struct GonePart {};  ///< since the files were listed

// Of versions.
struct Tags {
  std::vector<MapTag> tags;
};
struct Untagged {
  std::string tag;
};
struct Contributor {
  std::string client;
  std::vector<uint64_t> keyframes;  ///< their ids, ascending
};
struct Contributors {
  std::vector<Contributor> contributors;
  size_t unknown = 0;  ///< keyframes of which it is not known who brought them
};

// Of labels.
struct LabelSeen {
  std::string map;
  Label label;
};
struct Labels {
  std::vector<LabelSeen> labels;
};

// Of proposals.
struct ProposalSeen {
  std::string id;
  MapId map;
  std::string map_name;
  ProposalSummary summary;
};
struct Proposals {
  std::vector<ProposalSeen> proposals;
};
struct WholeProposal {
  ProposalSeen proposal;
  size_t image_bytes = 0;
  size_t measured = 0;
  Result<std::vector<ExpectedPoint>> expected_now;
};
struct ImagePiece {
  size_t bytes = 0;  ///< of the whole image
  std::vector<uint8_t> data;
};
struct AcceptedProposal {
  std::string id;
  MapId map;
  std::string client;
  KeyframeId keyframe;
};
struct DroppedProposal {
  std::string id;
};

// Of rights and of what was done.
struct Rights {
  cairn::Rights::Table table;
  std::map<MapId, std::string> names;  ///< of those that are served
  Timestamp now;
  std::optional<Timestamp> secured_since;
  bool is_kept = true;
};
struct ExplainedRights {
  std::string client;
  std::string map;
  Ruling ruling;
  std::vector<RuleSeen> rules;
  Ruling creating;
  std::vector<Membership> groups;
  std::string note;  ///< as of Done
};
struct Audit {
  std::vector<AuditEntry> entries;
};

using Answer = std::variant<Nothing, Done, Server, Rigs, Clients, Map, BusyMap, WholeMap, Maps, DeletedMap,
                            GoneMap, Copy, Archive, Piece, Parts, GonePart, FileCheck, MapTag, Tags, Untagged,
                            Contributors, LabelSeen, Labels, Proposals, WholeProposal, ImagePiece,
                            AcceptedProposal, DroppedProposal, Rights, ExplainedRights, Audit>;

}  // namespace told

/// Or why not.
using OperatorAnswer = Result<told::Answer>;
/// Answers an operator. To be called once, on the service's thread.
using AdminAnswer = std::function<void(OperatorAnswer answer)>;

/// Refusal of requests that need a store.
inline constexpr const char* kNoStore = "this server keeps nothing: start it with --store DIR";

[[nodiscard]] OperatorAnswer refusal(Error error);
[[nodiscard]] OperatorAnswer refusal(ErrorCode code, std::string message);
/// Refuses a request about a map that cannot be used, with the remedy.
[[nodiscard]] OperatorAnswer refusal(const DeletedMap& map);
[[nodiscard]] OperatorAnswer unknown_map(const std::string& name_or_id);
/// Refuses a request about a map that must be undeleted first.
[[nodiscard]] OperatorAnswer deleted_map(const std::string& name_or_id);
/// A refusal as the operator reads it, and as it goes on record.
[[nodiscard]] std::string words_of(const Error& refused);

}  // namespace cairn
