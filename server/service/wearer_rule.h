// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/base/time.h"
#include "common/map/ids.h"
#include "common/map/relocalization_answer.h"
#include "server/relocalization/relocalizer.h"
#include "server/service/wearer_list.h"

namespace cairn {

/// What counts for a lost camera while another of its wearer is tracked.
enum class WearerPolicy : uint8_t {
  /// The other's map first. All maps when the place is not confirmed there in two queries, or when another
  /// map explains clearly more of the image: the cameras of one person may well look at different
  /// workcells.
  kFirst = 0,
  /// The other's map and no other: the paper's rule.
  kOnly = 1,
};

struct WearerOptions {
  WearerPolicy policy = WearerPolicy::kFirst;
  std::optional<WearerList> registered;  ///< by the operator; nothing: whose a client claims to be
};

/// Cameras that one person wears are in one place: Castle, Klein and Murray, "Video-rate Localization in
/// Multiple Maps for Wearable Augmented Reality" (ISWC 2008), with one at the shoulder and one in the hand.
/// The first that finds itself narrows the answers to the others to its map. Pure: states, answers and times
/// are handed in. Used from one thread.
class WearerRule {
 public:
  /// A pose older than that says nothing of where the wearer is.
  static constexpr std::chrono::milliseconds kFresh{500};
  /// After so many queries in a row that were not confirmed in the maps of the wearer's other cameras, all
  /// maps count (kFirst).
  static constexpr int kQueries = 2;
  /// Ratio of the inliers in another map to those in the maps of the wearer's other cameras, above which they
  /// are clearly more. Measured once to choose it: two maps of one place, with two to five keyframes, have
  /// counts whose ratio is 1.35 at most; 2.6 where one has a quarter of the other's points.
  static constexpr double kClearlyMore = 2;

  explicit WearerRule(WearerOptions options) : options_(std::move(options)) {}

  /// What a tracker says of itself.
  struct Word {
    std::string wearer;    ///< claimed; empty: nobody's
    MapId verified_in;     ///< the map in which the pose of its latest frame is verified; none: in none
    Timestamp frame_time;  ///< the same in two words: nothing new has been seen
  };
  void heard(const std::string& client, const Word& word, MonotonicTime now);
  void left(const std::string& client) { cameras_.erase(client); }
  /// The wearer of a client's camera; empty: nobody in particular.
  [[nodiscard]] std::string wearer_of(const std::string& client) const;

  /// The maps in which a client's query is searched, and which of them first.
  struct Search {
    SearchScope scope;
    bool in_part = false;  ///< not in all of the maps that the client may find itself in
  };
  /// `findable`: the maps in which the client may find itself. Of others it is told nothing, not even by
  /// where it is looked for first.
  [[nodiscard]] Search search(const std::string& client, const MapSet& findable, MonotonicTime now) const;
  /// What of the answer found counts for the client, as its wearer's other cameras are tracked by now.
  /// `in_part`: as it was searched. To be called once for each query.
  [[nodiscard]] RelocalizationAnswer narrow(const std::string& client, const MapSet& findable, bool in_part,
                                            RelocalizationAnswer found, MonotonicTime now);

 private:
  struct Camera {
    std::string wearer;
    MapId verified_in;
    MonotonicTime verified_at;
    std::optional<Timestamp> frame_time;
    std::vector<MapId> missed_in;  ///< maps of the others in which it was not confirmed
    int missed = 0;                ///< queries in a row
  };
  [[nodiscard]] std::vector<MapId> maps_of_others(const std::string& client, const MapSet& findable,
                                                  MonotonicTime now) const;
  /// Counts the queries in a row that were not confirmed in `maps`; those until now.
  [[nodiscard]] int count_miss(const std::string& client, const std::vector<MapId>& maps, bool confirmed);

  WearerOptions options_;
  std::map<std::string, Camera> cameras_;  ///< by client
};

}  // namespace cairn
