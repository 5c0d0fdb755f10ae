// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/relocalizer.h"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <optional>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "server/relocalization/map_agreement.h"
#include "server/relocalization/votes.h"

namespace cairn {
namespace {

/// Length of the two orders of merit that are fused. Where pictures or words are led astray (other light) the
/// place is far down in both, yet at a like rank.
constexpr size_t kFused = 128;

/// So many keyframes of a place that has been confirmed are tried; then others are, which may look as much
/// like it; then so many more at least, for the best pose.
constexpr int kTriesOfPlace = 4;
constexpr size_t kMoreForPose = 4;

/// Where nothing is confirmed, so many neighbours of each keyframe that is half known are tried, and so many
/// in all.
constexpr size_t kNeighboursOfLead = 4;
constexpr size_t kTriesOfLeads = 4;

/// Keyframes of a map that measured fewer points in common are of different places.
constexpr size_t kInCommon = 5;

constexpr const char* kNothingToCompare = "there is no keyframe to compare with";

/// A picture that cannot be compared counts as the opposite of the query's.
Ranked rank(const IndexedMap& map, size_t keyframe, const QueryPicture& query) {
  constexpr float kOpposite = 2;  // a correlation of -1
  const float cost = unlikeness(*map.keyframes[keyframe], query);
  return {std::isfinite(cost) ? cost : kOpposite, &map, keyframe};
}

/// Two orders of merit in one: what stands high in both comes first (reciprocal rank fusion: Cormack et al.,
/// SIGIR 2009, with its constant). Ties: in the order of `by_picture`, then of `by_words`.
std::vector<Ranked> fuse(const std::vector<Ranked>& by_picture, const std::vector<Voted>& by_words,
                         const QueryPicture& query) {
  constexpr float kDamping = 60;
  std::vector<std::pair<float, Ranked>> fused;
  std::unordered_map<const IndexedKeyframe*, size_t> position;
  float place = kDamping;
  for (const Ranked& r : by_picture) {
    position.emplace(&r.indexed(), fused.size());
    fused.emplace_back(1 / ++place, r);
  }
  place = kDamping;
  for (const Voted& v : by_words) {
    const IndexedKeyframe& keyframe = *v.map->keyframes[v.keyframe];
    if (const auto same = position.find(&keyframe); same != position.end()) {
      fused[same->second].first += 1 / ++place;
    } else {
      fused.emplace_back(1 / ++place, rank(*v.map, v.keyframe, query));
    }
  }
  std::stable_sort(fused.begin(), fused.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<Ranked> ranked;
  ranked.reserve(fused.size());
  for (const auto& [_, r] : fused) ranked.push_back(r);
  return ranked;
}

PlaceCandidate begin_candidate(const Ranked& ranked) {
  PlaceCandidate candidate;
  candidate.map = ranked.map->snapshot->map;
  candidate.epoch = ranked.map->snapshot->epoch;
  candidate.revision = ranked.map->snapshot->revision;
  candidate.keyframe = ranked.indexed().id;
  return candidate;
}

/// The paper's answer: the nearest keyframe's pose, turned as the tiny images say.
PlaceCandidate guess(const Ranked& best, const Camera& camera, const TinyImage& tiny) {
  PlaceCandidate candidate = begin_candidate(best);
  candidate.score = best.cost;
  candidate.camera_from_keyframe =
      rotation_from_tiny(align_tiny(best.indexed().tiny, tiny), camera, tiny.width());
  candidate.reason = "nearest tiny image, not verified";
  return candidate;
}

PlaceCandidate make_candidate(const Ranked& ranked, const Confirmation& said, const KeyframePose& keyframe) {
  PlaceCandidate candidate = begin_candidate(ranked);
  candidate.score = 1 - ranked.cost;
  candidate.matches = said.agreeing;
  candidate.expected = said.expected;
  candidate.inliers = said.inliers;
  candidate.confirmed = said.confirmed;
  candidate.reason = said.reason;
  candidate.camera_from_keyframe = said.camera_from_map * keyframe.camera_from_map.inverse();
  return candidate;
}

/// So much that no other place can look better: the rest need not be tried.
bool is_clear(const Confirmation& said, const RelocOptions& options) {
  return said.confirmed && !said.changed && said.agreeing >= options.confirm.clear_agreeing &&
         evidence(said) >= options.confirm.clear_evidence;
}

struct Tried {
  Ranked ranked;
  PlaceCandidate candidate;
  Confirmation said;
  double mean_depth = 0;   ///< of the keyframe
  int tries_of_place = 1;  ///< keyframes tried that are of its place
};

/// Points that both keyframes of one map measured, counted up to `enough`.
size_t count_in_common(const IndexedKeyframe& a, const IndexedKeyframe& b,
                       size_t enough = std::numeric_limits<size_t>::max()) {
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

/// Whether a keyframe of a map is of the place of one that was tried.
bool is_of_place(const IndexedKeyframe& keyframe, const MapId& map, const Tried& tried) {
  return map == tried.candidate.map &&
         count_in_common(keyframe, tried.ranked.indexed(), kInCommon) == kInCommon;
}

/// What its rivals explain of a picture for which another is confirmed.
struct Rivalry {
  size_t most = 0;                 ///< corners that one of them explains
  std::vector<size_t> peculiar{};  ///< corners found that none of them explains
};

/// Another map of which any keyframe looks right is no rival: where maps overlap, both are right. Of a place
/// that has changed every other map is one: the part that stands may be what they have in common. In the map
/// itself whatever explains corners otherwise is one.
bool is_rival(const MapId& map, const Tried& judged, std::span<const Tried> tried) {
  if (map == judged.candidate.map || judged.said.changed) return true;
  return std::ranges::none_of(
      tried, [&](const Tried& t) { return t.candidate.map == map && t.said.confirmed && !t.said.changed; });
}

/// Corners, ascending, that a rival explains as something else: in the same map, as points that by the pose
/// that is judged lie elsewhere in the picture, as far as a pose that contradicts it would put them.
std::vector<size_t> explained_otherwise(const Tried& rival, const Tried& judged) {
  const double least_cosine = std::cos(kSamePose);
  const auto is_otherwise = [&](const ExplainedCorner& e) {
    if (rival.candidate.map != judged.candidate.map) return true;
    return e.ray.dot((judged.said.camera_from_map * e.position).normalized()) < least_cosine;
  };
  std::vector<size_t> corners;
  for (const ExplainedCorner& e : rival.said.explained) {
    if (is_otherwise(e)) corners.push_back(e.corner);
  }
  return corners;
}

Rivalry compare_with_rivals(const Tried& confirmed, std::span<const Tried> tried) {
  Rivalry rivalry{0, confirmed.said.found};
  for (const Tried& rival : tried) {
    if (!is_rival(rival.candidate.map, confirmed, tried)) continue;
    const std::vector<size_t> explained = explained_otherwise(rival, confirmed);
    rivalry.most = std::max(rivalry.most, explained.size());
    std::vector<size_t> left;
    std::ranges::set_difference(rivalry.peculiar, explained, std::back_inserter(left));
    rivalry.peculiar = std::move(left);
  }
  return rivalry;
}

/// What places have in common, the same desk, keyboard and carpet, speaks for none of them (the perceptual
/// aliasing of Cummins and Newman, IJRR 2008): believed is what has something to show of its own and explains
/// clearly more than what it is not. Why it is not; nothing: it is.
std::optional<std::string> find_why_common(const RelocOptions& options, const Tried& confirmed,
                                           std::span<const Tried> tried) {
  const Rivalry rivalry = compare_with_rivals(confirmed, tried);
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

bool contradict(const Tried& a, const Tried& b) {
  if (a.candidate.map != b.candidate.map) return false;
  const SE3& one = a.said.camera_from_map;
  const SE3& other = b.said.camera_from_map;
  return separation(one, other, std::min(a.mean_depth, b.mean_depth)) > kSamePose;
}

/// Of two poses in one map, one is about a part that has moved or about what is there more than once: the one
/// with which corners in more parts of the picture agree, or else more corners, stands, if nothing else
/// speaks against it; the other is refused in any case. Why a pose is; nothing: it is not.
std::optional<std::string> find_why_contradicted(const Tried& judged, std::span<const Tried> tried) {
  const auto extent = [](const Tried& t) { return std::tuple(t.said.agreeing_parts, t.said.agreeing); };
  const auto wider = std::ranges::find_if(tried, [&](const Tried& t) {
    return t.said.confirmed && contradict(judged, t) && extent(t) > extent(judged);
  });
  if (wider == tried.end()) return std::nullopt;
  return fmt::format("{} corners in {} of {} parts agree with another pose in this map, {} in {} with this",
                     wider->said.agreeing, wider->said.agreeing_parts, kParts, judged.said.agreeing,
                     judged.said.agreeing_parts);
}

/// Why what looks right by itself is not believed, given all else that has been tried; nothing: it is.
std::optional<std::string> find_why_refused(const RelocOptions& options, const Tried& judged,
                                            std::span<const Tried> tried) {
  auto refusal = find_why_contradicted(judged, tried);
  return refusal ? refusal : find_why_common(options, judged, tried);
}

/// Believed first, by how alike the picture is: from one keyframe the pose may be worse than from another,
/// and inliers do not tell. Then what looks right and is common, then the rest, in the order they were tried.
std::vector<PlaceCandidate> in_order(std::vector<Tried> tried) {
  std::stable_sort(tried.begin(), tried.end(), [](const Tried& a, const Tried& b) {
    if (a.candidate.confirmed != b.candidate.confirmed) return a.candidate.confirmed;
    if (a.said.confirmed != b.said.confirmed) return a.said.confirmed;
    return a.candidate.confirmed && a.said.alikeness > b.said.alikeness;
  });
  std::vector<PlaceCandidate> candidates;
  candidates.reserve(tried.size());
  for (Tried& t : tried) candidates.push_back(std::move(t.candidate));
  return candidates;
}

/// Which keyframes are tried.
enum class Tries : uint8_t { kRivalsFirst, kAll };

/// One question on its way through the keyframes.
class Inquiry {
 public:
  Inquiry(const Camera& camera, const PlaceView& view, const RelocOptions& options)
      : camera_(camera), view_(view), options_(options), grid_(view, camera), cells_(probed_cells(view)) {}

  /// Tries the most promising keyframes of the index that have not been tried. True: one of them is clear.
  bool search(const PlaceIndex& index, const QueryPicture& picture) {
    const auto shortlist = static_cast<size_t>(options_.shortlist);
    const size_t before = tried_.size();
    const NearPictures near(index, picture, options_.search);
    if (try_out(near.alike(shortlist), before + static_cast<size_t>(options_.by_picture_alone))) return true;
    const auto fused = fuse(near.alike(kFused), vote(index, near.maps(), view_, cells_, kFused), picture);
    if (try_out(fused, before + shortlist)) return true;
    if (!is_any_confirmed() && follow_leads(picture)) return true;
    if (!is_any_confirmed()) return false;
    return try_out(fused, std::max(before + shortlist, tried_.size() + kMoreForPose), Tries::kAll);
  }
  /// By what it shows itself, whoever else shows the same.
  [[nodiscard]] bool is_any_confirmed() const {
    return std::any_of(tried_.begin(), tried_.end(), [](const Tried& t) { return t.said.confirmed; });
  }
  [[nodiscard]] std::vector<PlaceCandidate> take_candidates() {
    for (Tried& t : tried_) {
      if (!t.said.confirmed) continue;
      const auto refusal = find_why_refused(options_, t, tried_);
      t.candidate.confirmed = !refusal;
      t.candidate.reason = refusal.value_or("");
    }
    return in_order(std::move(tried_));
  }

 private:
  /// Whether a keyframe is of a place that has been confirmed and enough asked about: the others are its
  /// rivals.
  [[nodiscard]] bool is_settled(const IndexedKeyframe& keyframe, const MapId& map) const {
    return std::ranges::any_of(tried_, [&](const Tried& t) {
      return t.said.confirmed && t.tries_of_place >= kTriesOfPlace && is_of_place(keyframe, map, t);
    });
  }

  [[nodiscard]] bool was_asked(const IndexedKeyframe& keyframe) const {
    return std::ranges::find(asked_, &keyframe) != asked_.end();
  }

  /// Keyframes of which some matches support each other while too few agree on a pose to tell, best first:
  /// from there the place is seen from too far or aside.
  [[nodiscard]] std::vector<Ranked> leads() const {
    std::vector<const Tried*> found;
    for (const Tried& t : tried_) {
      if (t.said.supported >= options_.confirm.min_supported &&
          t.said.agreeing < options_.confirm.enough_agreeing)
        found.push_back(&t);
    }
    std::ranges::stable_sort(found, std::greater(),
                             [](const Tried* t) { return std::tuple(t->said.agreeing, t->said.supported); });
    std::vector<Ranked> leads;
    for (const Tried* t : found) leads.push_back(t->ranked);
    return leads;
  }

  /// Those that measured most points in common with it and have not been asked.
  [[nodiscard]] std::vector<Ranked> neighbours_of(const Ranked& lead, const QueryPicture& picture) const {
    std::vector<std::pair<size_t, size_t>> shared;  // points in common, keyframe
    for (size_t k = 0; k < lead.map->keyframes.size(); ++k) {
      const IndexedKeyframe& keyframe = *lead.map->keyframes[k];
      const size_t common = was_asked(keyframe) ? 0 : count_in_common(keyframe, lead.indexed());
      if (common >= kInCommon) shared.emplace_back(common, k);
    }
    std::ranges::stable_sort(shared, std::greater(), &std::pair<size_t, size_t>::first);
    if (shared.size() > kNeighboursOfLead) shared.resize(kNeighboursOfLead);
    std::vector<Ranked> neighbours;
    for (const auto& [_, k] : shared) neighbours.push_back(rank(*lead.map, k, picture));
    return neighbours;
  }

  /// A neighbour of what is half known may see the place better, and stand too low by picture and words to be
  /// tried. True: one is clear.
  bool follow_leads(const QueryPicture& picture) {
    const size_t most = tried_.size() + kTriesOfLeads;
    for (const Ranked& lead : leads()) {
      if (tried_.size() >= most) return false;
      if (try_out(neighbours_of(lead, picture), most)) return true;
    }
    return false;
  }

  /// Counts it among what was tried of its place.
  void add(Tried tried) {
    for (Tried& before : tried_) {
      if (!is_of_place(before.ranked.indexed(), before.candidate.map, tried)) continue;
      ++before.tries_of_place;
      ++tried.tries_of_place;
    }
    tried_.push_back(std::move(tried));
  }

  /// Asks geometry about the keyframes that it has not been asked about, until one is clear (true) or `most`
  /// have been tried in all.
  bool try_out(std::span<const Ranked> ranked, size_t most, Tries tries = Tries::kRivalsFirst) {
    for (const Ranked& r : ranked) {
      if (tried_.size() >= most) return false;
      if (was_asked(r.indexed())) continue;
      const KeyframePose* pose = r.map->snapshot->find(r.indexed().id);
      if (pose == nullptr) continue;
      if (tries == Tries::kRivalsFirst && is_settled(r.indexed(), r.map->snapshot->map)) continue;
      Confirmation said = confirm(view_, cells_, grid_, camera_, *r.map, r.keyframe, options_.confirm);
      asked_.push_back(&r.indexed());
      PlaceCandidate candidate = make_candidate(r, said, *pose);
      add({r, std::move(candidate), std::move(said), static_cast<double>(pose->mean_depth)});
      if (is_clear(tried_.back().said, options_) && !find_why_refused(options_, tried_.back(), tried_))
        return true;
    }
    return false;
  }

  const Camera& camera_;
  const PlaceView& view_;
  const RelocOptions& options_;
  CornerGrid grid_;
  std::vector<CellList> cells_;
  std::vector<const IndexedKeyframe*> asked_;
  std::vector<Tried> tried_;
};

PlaceAnswer answer_as_paper(const PlaceIndex& index, const Camera& camera, const TinyImage& tiny) {
  PlaceAnswer result;
  const Ranked nearest = find_nearest(index, tiny);
  if (nearest.map == nullptr) {
    result.reason = kNothingToCompare;
    return result;
  }
  result.verdict = PlaceVerdict::kUnconfirmed;
  result.candidates.push_back(guess(nearest, camera, tiny));
  result.reason = result.candidates.front().reason;
  return result;
}

}  // namespace

PlaceAnswer relocalize(const PlaceIndex& index, const Camera& camera, const PlaceView& view,
                       const RelocOptions& options, const SearchScope& scope) {
  const PlaceIndex first = index.only(scope.first);
  if (scope.only && !scope.first.empty()) return relocalize(first, camera, view, options);
  const QueryPicture picture(TinyImage(view.small, kPlaceBlur));
  if (options.method == RelocMethod::kPaper) return answer_as_paper(index, camera, picture.tiny);
  PlaceAnswer result;
  Inquiry inquiry(camera, view, options);
  if (scope.first.empty() || !inquiry.search(first, picture)) inquiry.search(index, picture);
  const bool is_any_confirmed = inquiry.is_any_confirmed();
  result.candidates = inquiry.take_candidates();
  if (result.candidates.empty()) {
    result.reason = kNothingToCompare;
  } else if (result.candidates.front().confirmed) {
    result.verdict = PlaceVerdict::kConfirmed;
  } else if (is_any_confirmed) {
    result.reason = result.candidates.front().reason;
  } else {
    result.reason = fmt::format("none of the {} keyframes tried, of {}, agrees with the corners seen",
                                result.candidates.size(), index.keyframe_count());
  }
  const auto told = static_cast<size_t>(options.shortlist);
  if (result.candidates.size() > told) result.candidates.resize(told);
  return result;
}

}  // namespace cairn
