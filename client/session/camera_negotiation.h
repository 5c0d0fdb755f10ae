// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "client/session/session_types.h"
#include "common/map/snapshot.h"
#include "common/wire/messages.h"

namespace cairn {

/// Which values of our camera are in use, between what this client believes of it and what the server's maps
/// find in self-calibration (server/mapping). A revision of a map names the version that it
/// was made with; it is tracked on together with these values. Each map and epoch counts its own versions.
/// Pure. One thread.
class CameraNegotiation {
 public:
  /// `sigma`: as SessionOptions::prior_sigma; empty: the values are exact, and nobody is asked about them.
  CameraNegotiation(ClientId client, const std::vector<double>& sigma, const CameraPtr& camera);

  /// A map says what its self-calibration has found. False: such a camera cannot be, which is said once of
  /// each map. What is of another camera, of one that is exact, or overtaken is passed over.
  [[nodiscard]] bool take(const wire::CameraEstimate& estimate);
  /// An estimate is no more; of `key` only what names it counts.
  void forget(const wire::CameraEstimate& key);

  /// Whether a revision can be tracked on: the values that it was made with are in use, or there to be used.
  [[nodiscard]] bool has_values_of(const MapSnapshot& map) const;
  /// Whether the latest values that this map has told of our camera are none that a camera can have.
  [[nodiscard]] bool is_unsound(MapId map) const { return unsound_.contains(map); }
  /// Whether a map made from our seed calibrates our camera itself, or has no need to, since the camera is
  /// known. False: it takes what is merely believed of our camera for exact, as servers from before
  /// self-calibration do.
  [[nodiscard]] bool is_self_calibrated_by(const MapSnapshot& own) const;

  /// Takes the values that go with this revision into use. Nothing where they are in use, or not there yet.
  [[nodiscard]] std::optional<CameraUpdate> use_values_of(const MapSnapshot& map);
  /// Takes the values of the beginning into use. Nothing where they are in use, or where the camera is known.
  /// What a map merely believes is not handed on to the next, whose prior would wander from map to map.
  [[nodiscard]] std::optional<CameraUpdate> use_first_values();

  /// The values in use, as the server is told them.
  [[nodiscard]] const wire::CameraMessage& in_use() const { return in_use_; }
  /// The values in use where they are to be announced (again); written() must follow.
  [[nodiscard]] std::optional<wire::CameraMessage> next_announcement();
  void written(bool is_written);
  /// Announces the values again, when the other side has forgotten them. try_again() does so for values that
  /// could not be written.
  void announce_again();
  void try_again();
  /// Whether the values in use have been announced: before that no command may name them.
  [[nodiscard]] bool is_announced() const { return announcing_ == Announcing::kDone; }

 private:
  /// The values that a map's self-calibration has given.
  struct MapEstimate {
    Epoch epoch;
    CameraUpdate update;
  };
  /// The map that values come from, and their version in it.
  struct Source {
    MapId map;
    Epoch epoch;
    uint32_t version = 0;
    bool operator==(const Source&) const = default;
  };
  /// Estimates overtake revisions: so many are kept of each map, the newest last.
  static constexpr size_t kEstimatesKept = 8;

  [[nodiscard]] const CameraVersion* ours_in(const MapSnapshot& map) const;
  /// The values that a revision was made with. Nothing when those in use are to be kept: the revision names
  /// none of ours, or these, or ours are known already (calibrated elsewhere, or exact from the start).
  [[nodiscard]] std::optional<Source> other_values_of(const MapSnapshot& map) const;
  /// The values that the revision was made with or, where those were overtaken, the next later ones of its
  /// map; null when they are not there yet.
  [[nodiscard]] const MapEstimate* find(const Source& source) const;
  [[nodiscard]] CameraUpdate use(const std::optional<Source>& source, CameraUpdate update);

  wire::CameraMessage in_use_;
  enum class Announcing : uint8_t { kDue, kUnderWay, kFailed, kDone } announcing_ = Announcing::kDue;
  const CameraPtr first_;
  /// How well the camera was known when the session began, as in IntrinsicsPrior.
  double first_focal_sigma_ = 0;
  double first_k1_sigma_ = 0;
  std::map<MapId, std::deque<MapEstimate>> found_;
  std::optional<Source> source_;  ///< of the values in use; nothing: as the session began
  std::set<MapId> unsound_;
  std::set<MapId> told_unsound_;
};

}  // namespace cairn
