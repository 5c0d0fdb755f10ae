// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/rivals.h"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <tuple>
#include <utility>
#include <vector>

#include "server/relocalization/map_agreement.h"

namespace cairn {
namespace {

/// What the rivals of a confirmed place explain of the image.
struct Rivalry {
  size_t most = 0;                 ///< corners that one of them explains
  std::vector<size_t> peculiar{};  ///< corners found that none of them explains
};

/// Whether keyframes of `map` are rivals of the judged place. Another map of which any keyframe looks right
/// is no rival: where maps overlap, both are right. Of a place that has changed every other map is one: the
/// part that stands may be what they have in common. In the map itself whatever explains corners otherwise is
/// one.
bool is_rival(const MapId& map, const PlaceHypothesis& judged, std::span<const PlaceHypothesis> hypotheses) {
  if (map == judged.candidate.map || judged.said.changed) return true;
  return std::ranges::none_of(hypotheses, [&](const PlaceHypothesis& t) {
    return t.candidate.map == map && t.said.confirmed && !t.said.changed;
  });
}

/// Corners, ascending, that a rival explains as something else. In the same map these are corners whose
/// points the judged pose puts more than `same_pose` [rad] elsewhere in the image.
std::vector<size_t> explained_otherwise(const PlaceHypothesis& rival, const PlaceHypothesis& judged,
                                        double same_pose) {
  const double least_cosine = std::cos(same_pose);
  const auto is_otherwise = [&](const ExplainedCorner& e) {
    if (rival.candidate.map != judged.candidate.map) return true;
    return e.ray.dot((*judged.said.camera_from_map * e.position).normalized()) < least_cosine;
  };
  std::vector<size_t> corners;
  for (const ExplainedCorner& e : rival.said.explained) {
    if (is_otherwise(e)) corners.push_back(e.corner);
  }
  return corners;
}

Rivalry compare_with_rivals(const PlaceHypothesis& confirmed, std::span<const PlaceHypothesis> hypotheses,
                            double same_pose) {
  Rivalry rivalry{0, confirmed.said.found};
  for (const PlaceHypothesis& rival : hypotheses) {
    if (!is_rival(rival.candidate.map, confirmed, hypotheses)) continue;
    const std::vector<size_t> explained = explained_otherwise(rival, confirmed, same_pose);
    rivalry.most = std::max(rivalry.most, explained.size());
    std::vector<size_t> left;
    std::ranges::set_difference(rivalry.peculiar, explained, std::back_inserter(left));
    rivalry.peculiar = std::move(left);
  }
  return rivalry;
}

/// Says why a place is refused as common; nothing if it is not. What places have in common, the same desk,
/// keyboard and carpet, speaks for none of them (the perceptual aliasing of Cummins and Newman, IJRR 2008): a
/// place is believed if it has something to show of its own and explains clearly more than any rival.
std::optional<std::string> find_why_common(const RelocOptions& options, const PlaceHypothesis& confirmed,
                                           std::span<const PlaceHypothesis> hypotheses) {
  const Rivalry rivalry = compare_with_rivals(confirmed, hypotheses, options.same_pose);
  const size_t found = confirmed.said.found.size();
  const size_t explained = confirmed.said.explained.size();
  if (static_cast<double>(rivalry.peculiar.size()) >= options.least_peculiar * static_cast<double>(found) &&
      static_cast<double>(explained) >= options.least_margin * static_cast<double>(rivalry.most))
    return std::nullopt;
  return fmt::format(
      "more than one place looks like this: it explains {} corners, another {}, and {} of {} found are its "
      "own only",
      explained, rivalry.most, rivalry.peculiar.size(), found);
}

bool contradict(const PlaceHypothesis& a, const PlaceHypothesis& b, double same_pose) {
  if (a.candidate.map != b.candidate.map) return false;
  const SE3& one = *a.said.camera_from_map;
  const SE3& other = *b.said.camera_from_map;
  return separation(one, other, std::min(a.mean_depth, b.mean_depth)) > same_pose;
}

/// Says why a pose is refused because a wider one in its map contradicts it; nothing if none does. One of the
/// two is about a part that has moved or about what is there more than once. The pose with which corners in
/// more cells of the image agree, or else more corners, stands, if nothing else speaks against it; the other
/// is refused in any case.
std::optional<std::string> find_why_contradicted(const RelocOptions& options, const PlaceHypothesis& judged,
                                                 std::span<const PlaceHypothesis> hypotheses) {
  const auto extent = [](const PlaceHypothesis& t) {
    return std::tuple(t.said.agreeing_cells, t.said.agreeing);
  };
  const auto wider = std::ranges::find_if(hypotheses, [&](const PlaceHypothesis& t) {
    return t.said.confirmed && contradict(judged, t, options.same_pose) && extent(t) > extent(judged);
  });
  if (wider == hypotheses.end()) return std::nullopt;
  return fmt::format("{} corners in {} of {} parts agree with another pose in this map, {} in {} with this",
                     wider->said.agreeing, wider->said.agreeing_cells, kImageCells, judged.said.agreeing,
                     judged.said.agreeing_cells);
}

/// Says why a place is refused by other keyframes that put the camera there, too, but show something else in
/// cells of the image; nothing if it is not. Where these are so many, the keyframe that agrees is right by
/// chance. Never refuses a place that has changed.
std::optional<std::string> find_why_outvoted(const RelocOptions& options, const PlaceHypothesis& judged,
                                             std::span<const PlaceHypothesis> hypotheses) {
  if (judged.said.changed) return std::nullopt;
  const auto is_same = [&](const PlaceHypothesis& t) {
    return t.candidate.map == judged.candidate.map && t.said.inliers > 0 &&
           !contradict(t, judged, options.same_pose);
  };
  const auto pro = std::ranges::count_if(
      hypotheses, [&](const PlaceHypothesis& t) { return t.said.confirmed && is_same(t); });
  const auto con = std::ranges::count_if(hypotheses, [&](const PlaceHypothesis& t) {
    return !t.said.confirmed && t.said.inconsistent_cells > options.confirm.by_image.inconsistent_cells &&
           is_same(t);
  });
  if (con < options.outvoted_by * pro) return std::nullopt;
  return fmt::format("{} keyframes show this place otherwise in part, {} as it is", con, pro);
}

}  // namespace

size_t count_in_common(const IndexedKeyframe& a, const IndexedKeyframe& b, size_t enough) {
  size_t shared = 0;
  for (auto i = a.measured.begin(), j = b.measured.begin();
       i != a.measured.end() && j != b.measured.end() && shared < enough;) {
    if (*i < *j) {
      ++i;
    } else if (*j < *i) {
      ++j;
    } else {
      ++shared;
      ++i;
      ++j;
    }
  }
  return shared;
}

bool is_of_place(const IndexedKeyframe& keyframe, const MapId& map, const PlaceHypothesis& hypothesis,
                 size_t in_common) {
  return map == hypothesis.candidate.map &&
         count_in_common(keyframe, hypothesis.ranked.indexed(), in_common) == in_common;
}

std::optional<std::string> find_why_refused(const RelocOptions& options, const PlaceHypothesis& judged,
                                            std::span<const PlaceHypothesis> hypotheses) {
  auto refusal = find_why_contradicted(options, judged, hypotheses);
  if (!refusal) refusal = find_why_outvoted(options, judged, hypotheses);
  return refusal ? refusal : find_why_common(options, judged, hypotheses);
}

}  // namespace cairn
