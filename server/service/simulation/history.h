// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "server/access/rights.h"
#include "server/service/simulation/in_process.h"
#include "server/service/simulation/made_map.h"

namespace cairn::simulation {

/// All that a server has said through its starts and ends, held against what it has been asked and against
/// what it keeps. What contradicts goes into a list of violations.
class History {
 public:
  /// The rights of clients, as the policy in force has them.
  struct Allowed {
    std::function<Right(const std::string& client, MapId map)> in_map;
    std::function<bool(const std::string& client)> may_create;
  };
  [[nodiscard]] const std::vector<std::string>& violations() const { return violations_; }
  void violated(std::string what) { violations_.push_back(std::move(what)); }

  void server_started();
  [[nodiscard]] int server_starts() const { return server_; }
  /// Until the next one starts.
  void allow_as(Allowed allowed) { allowed_ = std::move(allowed); }

  // What reaches the server. A command may do so more than once.
  void arrives(const std::string& client, const wire::MapSeed& seed);
  void arrives(const std::string& client, const wire::KeyframeOffer& offer);
  void arrives(const std::string& client, const wire::ClientRequest& request);

  // What it says.
  void revised(MapId map, const MapSnapshotPtr& newest);
  void delivered(const std::string& client, const Delivery& delivery);
  /// The client listens anew.
  void connected(const std::string& client) { listed_[client].clear(); }

  // What operators have been told that they did.
  void renamed(MapId map, const std::string& name) { maps_[map].name = name; }
  void deleted(MapId map) { maps_[map].is_deleted = true; }
  void undeleted(MapId map, const std::string& name);
  void asked_to_tag(MapId map) { maps_[map].ask_to_tag(); }
  void tagged(MapId map, const std::string& tag);
  [[nodiscard]] std::set<std::string> tags_of(MapId map) const { return maps_.at(map).tags(); }
  void asked_to_roll_back(MapId map, const std::string& tag);
  void rolled_back(MapId map);
  void not_rolled_back(MapId map) { maps_[map].refuse_roll_back(); }
  void asked_to_copy(MapId map);
  void copied(MapId map, MapId copy, const std::string& name);
  /// Notes that what was kept aside may be accepted from now on.
  void asked_to_accept(MapId map) { maps_[map].proposals_are_accepted = true; }
  /// Notes a proposal that waits to be decided.
  void proposed(const std::string& id);
  /// Notes the decision on a proposal. `keyframe` nothing: it was dropped.
  void decided(const std::string& id, MapId map, std::optional<KeyframeId> keyframe);
  /// What is known of each map that a backup must hold which is begun now.
  [[nodiscard]] std::map<MapId, MadeMap> made_so_far() const { return maps_; }

  /// Maps of which somebody has heard that they were made.
  [[nodiscard]] std::vector<MapId> maps() const;
  [[nodiscard]] bool is_deleted(MapId map) const { return maps_.at(map).is_deleted; }

  /// No server uses the folder: whether all that was said is there, once.
  void check_store(const std::filesystem::path& folder);
  /// A store that was restored from a backup: what was known of each map when its copy was asked for is
  /// there.
  void check_restored(const std::filesystem::path& folder, const std::map<MapId, MadeMap>& known);
  /// Checks that each client has been told of just those maps that it may read, by their right names. To be
  /// called when nothing is under way.
  void check_listed(const std::set<std::string>& connected_clients);

 private:
  using Command = std::tuple<std::string, SessionId, uint64_t>;
  struct Asked {
    bool was_allowed = false;     ///< at one of the times when it arrived
    MadeMap::Moment arrived = 0;  ///< first
    MapId map;
    std::vector<Timestamp> times;  ///< of the images
    wire::ClientRequest request{};
  };
  struct Said {
    bool is_accepted = false;
    MapId map;
    KeyframeId keyframe;
    LabelId label;
    int server = 0;  ///< the start at which it was said first
  };
  struct Shown {
    MapSnapshotPtr first;
    MapSnapshotPtr newest;
    std::set<KeyframeId> keyframes;  ///< in any revision
  };
  void say(const std::string& client, const wire::OfferVerdict& verdict);
  void say(const std::string& client, const wire::SeedVerdict& verdict);
  void say(const std::string& client, const wire::ClientReply& reply);
  void say(const std::string& client, const wire::RelocAnswer& answer);
  /// Whether it is accepted now, and was not before.
  template <typename Outcome>
  [[nodiscard]] bool say_decided(const std::string& what, const Command& command, const Outcome& outcome,
                                 bool accepted, std::map<Command, Said>* said,
                                 const std::map<Command, Asked>& asked);
  void check_readable(const std::string& client, MapId map, const char* what);
  template <typename Message>
  [[nodiscard]] Asked& arrived(std::map<Command, Asked>* asked, const std::string& client,
                               const Message& message);
  void check_follows(const MapSnapshot& before, const MapSnapshot& now);

  Allowed allowed_;
  int server_ = 0;
  std::vector<std::string> violations_;
  std::map<Command, Asked> offers_asked_;
  std::map<Command, Asked> seeds_asked_;
  std::map<Command, Asked> requests_asked_;
  std::map<Command, Said> offers_;
  std::map<Command, Said> seeds_;
  std::map<Command, Said> requests_;
  std::map<std::tuple<std::string, SessionId, int, char>, uint64_t> last_decided_;
  std::map<MapId, MadeMap> maps_;
  MadeMap::Moment now_ = 0;  ///< counts what arrives and what is told
  struct Copying {
    MadeMap known;  ///< when it was asked for
    std::vector<MapSnapshotPtr> revisions;
  };
  std::map<MapId, Copying> copying_;
  std::map<std::string, bool> proposals_;  ///< those that were listed; whether one was decided
  std::map<MapId, Shown> shown_;
  std::map<std::string, std::map<MapId, wire::MapInfo>> listed_;
};

}  // namespace cairn::simulation
