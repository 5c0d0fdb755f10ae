// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/geometry/se3.h"
#include "common/map/ids.h"

namespace cairn {

/// How a relocalization query ended.
enum class RelocalizationVerdict : uint8_t {
  kConfirmed = 0,    ///< geometry agrees; the tracker's verification is still to come
  kUnconfirmed = 1,  ///< a guess to be examined (the 2008 way)
  kNotKnown = 2,     ///< no place of any map looks like it
  kNotThere = 3,     ///< none of the maps that count for now, or no answer could be found: it is left open
  kLast = kNotThere,
};
/// Whether one of the candidates is worth trying.
[[nodiscard]] constexpr bool has_place(RelocalizationVerdict verdict) {
  return verdict == RelocalizationVerdict::kConfirmed || verdict == RelocalizationVerdict::kUnconfirmed;
}
[[nodiscard]] constexpr const char* to_string(RelocalizationVerdict verdict) {
  return verdict == RelocalizationVerdict::kConfirmed     ? "confirmed"
         : verdict == RelocalizationVerdict::kUnconfirmed ? "unconfirmed"
         : verdict == RelocalizationVerdict::kNotThere    ? "not there"
                                                          : "not known";
}

/// A keyframe near which the image may have been taken. The pose is relative to it, so it survives
/// adjustments on the way.
struct PlaceCandidate {
  MapId map;
  Epoch epoch;
  Revision revision;  ///< with whose positions it was judged
  KeyframeId keyframe;
  SE3 camera_from_keyframe;  ///< not confirmed: the last pose examined; none was found: the keyframe's own
  float score = 0;           ///< of the tiny images; the method's own unit (relocalizer.h)
  int matches = 0;           ///< corners that look like points of the keyframe and agree on a pose
  int inliers = 0;           ///< points of the map around that pose which it explains
  int expected = 0;          ///< points of the map around that pose which project into the image
  bool confirmed = false;
  std::string reason;  ///< for a person: why it is not confirmed
};

struct RelocalizationAnswer {
  RelocalizationVerdict verdict = RelocalizationVerdict::kNotKnown;
  std::vector<PlaceCandidate> candidates;  ///< best first
  std::string reason;                      ///< for a person, when not confirmed
};

}  // namespace cairn
