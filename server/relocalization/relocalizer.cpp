// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/relocalizer.h"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <span>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "server/relocalization/rivals.h"

namespace cairn {
namespace {

constexpr const char* kNothingToCompare = "there is no keyframe to compare with";

/// Ranks a keyframe by its tiny image. One that cannot be compared counts as the opposite of the query's.
Ranked rank(const IndexedMap& map, size_t keyframe, const QueryImage& query) {
  constexpr float kOpposite = 2;  // a correlation of -1
  const float cost = dissimilarity(*map.keyframes[keyframe], query);
  return {std::isfinite(cost) ? cost : kOpposite, &map, keyframe};
}

/// Fuses two rankings: what stands high in both comes first (reciprocal rank fusion: Cormack et al., SIGIR
/// 2009). `damping`: its constant. Ties: in the order of `by_image`, then of `by_words`.
std::vector<Ranked> fuse(const std::vector<Ranked>& by_image, const std::vector<Voted>& by_words,
                         const QueryImage& query, float damping) {
  std::vector<std::pair<float, Ranked>> fused;
  std::unordered_map<const IndexedKeyframe*, size_t> position;
  float place = damping;
  for (const Ranked& r : by_image) {
    position.emplace(&r.indexed(), fused.size());
    fused.emplace_back(1 / ++place, r);
  }
  place = damping;
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
  if (said.camera_from_map)
    candidate.camera_from_keyframe = *said.camera_from_map * keyframe.camera_from_map.inverse();
  return candidate;
}

/// Whether a confirmed place has so much evidence that no other can look better, so that the rest need not be
/// examined.
bool is_clear(const Confirmation& said, const RelocOptions& options) {
  return said.confirmed && !said.changed && said.agreeing >= options.confirm.clear_agreeing &&
         evidence(said) >= options.confirm.clear_evidence;
}

/// Sorts hypotheses: first those that are believed, by how similar the image is, since from one keyframe the
/// pose may be worse than from another and inliers do not tell. Then come those that are confirmed by
/// themselves but refused for others, then the rest. Otherwise the order in which they were examined stays.
void put_in_order(std::vector<PlaceHypothesis>* hypotheses) {
  std::ranges::stable_sort(*hypotheses, [](const PlaceHypothesis& a, const PlaceHypothesis& b) {
    if (a.candidate.confirmed != b.candidate.confirmed) return a.candidate.confirmed;
    if (a.said.confirmed != b.said.confirmed) return a.said.confirmed;
    return a.candidate.confirmed && a.said.similarity > b.said.similarity;
  });
}

/// A keyframe that was prefiltered.
struct Prefiltered {
  Ranked ranked;
  const KeyframePose* pose;
  Prefilter prefilter;
};

/// Which keyframes are looked at closer: kOpenPlaces leaves out those of a confirmed place of which enough
/// have been examined, kAnyPlace does not.
enum class Examine : uint8_t { kOpenPlaces, kAnyPlace };

/// One query on its way through the keyframes.
class Inquiry {
 public:
  Inquiry(const Camera& camera, const PlaceView& view, const RelocOptions& options)
      : camera_(camera), view_(view), options_(options), grid_(view, camera), cells_(probed_cells(view)) {}

  /// Examines the most promising keyframes of the index that have not been examined yet. Returns true if one
  /// of them is clear.
  bool search(const PlaceIndex& index, const QueryImage& query) {
    const auto shortlist = static_cast<size_t>(options_.shortlist);
    const size_t before = asked_.size();
    const size_t most_poses = poses_ + options_.most_poses;
    // Those of the maps searched before wait until these have been prefiltered, too.
    std::vector<Prefiltered> before_these = std::exchange(waiting_, {});
    const NearImages near(index, query, options_.search, options_.images_near);
    const auto similar = near.most_similar(shortlist);
    for (size_t n = 1; n <= static_cast<size_t>(options_.by_image_alone); ++n) {
      prefilter(similar, before + n);
      if (look_closer(most_poses)) return true;
    }
    std::ranges::move(before_these, std::back_inserter(waiting_));
    const auto voted = vote(index, near.maps(), view_, cells_, options_.fused, options_.votes);
    prefilter(fuse(near.most_similar(options_.fused), voted, query, options_.fusion_damping),
              before + shortlist);
    if (look_closer(most_poses)) return true;
    if (!is_any_confirmed() && follow_leads(query, most_poses)) return true;
    return is_any_believed() && most_similar_believed_ < options_.sure_similarity &&
           look_closer(poses_ + options_.more_for_pose, Examine::kAnyPlace);
  }
  /// Whether a place is confirmed by what it shows itself, even if rivals show the same.
  [[nodiscard]] bool is_any_confirmed() const {
    return std::any_of(hypotheses_.begin(), hypotheses_.end(),
                       [](const PlaceHypothesis& h) { return h.said.confirmed; });
  }
  [[nodiscard]] std::vector<PlaceCandidate> take_candidates() {
    for (PlaceHypothesis& t : hypotheses_) {
      if (!t.said.confirmed) continue;
      const auto refusal = find_why_refused(options_, t, hypotheses_);
      t.candidate.confirmed = !refusal;
      t.candidate.reason = refusal.value_or("");
    }
    put_in_order(&hypotheses_);
    while (!hypotheses_.empty() && hypotheses_.front().candidate.confirmed && !settle_first())
      put_in_order(&hypotheses_);
    std::vector<PlaceCandidate> candidates;
    candidates.reserve(hypotheses_.size());
    for (PlaceHypothesis& t : hypotheses_) candidates.push_back(std::move(t.candidate));
    return candidates;
  }

 private:
  /// Whether a place is confirmed and not refused for what others show.
  [[nodiscard]] bool is_any_believed() const { return most_similar_believed_ >= 0; }

  /// Whether a keyframe is of a confirmed place of which enough keyframes have been examined. All others are
  /// rivals of that place.
  [[nodiscard]] bool is_settled(const IndexedKeyframe& keyframe, const MapId& map) const {
    return std::ranges::any_of(hypotheses_, [&](const PlaceHypothesis& t) {
      return t.said.confirmed && t.hypotheses_of_place >= options_.hypotheses_of_place &&
             is_of_place(keyframe, map, t, options_.in_common);
    });
  }

  [[nodiscard]] bool was_asked(const IndexedKeyframe& keyframe) const {
    return std::ranges::find(asked_, &keyframe) != asked_.end();
  }

  /// Keyframes of which some matches support each other while too few agree on a pose, best first: they may
  /// see the place from too far away or from aside.
  [[nodiscard]] std::vector<Ranked> leads() const {
    std::vector<const PlaceHypothesis*> found;
    for (const PlaceHypothesis& t : hypotheses_) {
      if (t.said.supported >= options_.confirm.min_supported &&
          t.said.agreeing < options_.confirm.enough_agreeing)
        found.push_back(&t);
    }
    std::ranges::stable_sort(found, std::greater(), [](const PlaceHypothesis* t) {
      return std::tuple(t->said.agreeing, t->said.supported);
    });
    std::vector<Ranked> leads;
    for (const PlaceHypothesis* t : found) leads.push_back(t->ranked);
    return leads;
  }

  /// Keyframes that measured most points in common with `lead` and have not been examined.
  [[nodiscard]] std::vector<Ranked> neighbours_of(const Ranked& lead, const QueryImage& query) const {
    std::vector<std::pair<size_t, size_t>> shared;  // points in common, keyframe
    for (size_t k = 0; k < lead.map->keyframes.size(); ++k) {
      const IndexedKeyframe& keyframe = *lead.map->keyframes[k];
      const size_t common = was_asked(keyframe) ? 0 : count_in_common(keyframe, lead.indexed());
      if (common >= options_.in_common) shared.emplace_back(common, k);
    }
    std::ranges::stable_sort(shared, std::greater(), &std::pair<size_t, size_t>::first);
    if (shared.size() > options_.neighbours_of_lead) shared.resize(options_.neighbours_of_lead);
    std::vector<Ranked> neighbours;
    for (const auto& [_, k] : shared) neighbours.push_back(rank(*lead.map, k, query));
    return neighbours;
  }

  /// Examines the neighbours of leads: they may see the place better, yet stand too low by images and words
  /// to be examined otherwise. Prefilters none that could not be looked at closer. Returns true if one is
  /// clear.
  bool follow_leads(const QueryImage& query, size_t most_poses) {
    const size_t most = asked_.size() + options_.hypotheses_of_leads;
    for (const Ranked& lead : leads()) {
      if (asked_.size() >= most || poses_ >= most_poses) return false;
      prefilter(neighbours_of(lead, query), most);
      if (look_closer(most_poses)) return true;
    }
    return false;
  }

  /// Adds a hypothesis, counts it among those of its place, and judges all anew, as it may be a rival of any
  /// that were believed.
  void add(PlaceHypothesis hypothesis) {
    for (PlaceHypothesis& before : hypotheses_) {
      if (!is_of_place(before.ranked.indexed(), before.candidate.map, hypothesis, options_.in_common))
        continue;
      ++before.hypotheses_of_place;
      ++hypothesis.hypotheses_of_place;
    }
    hypotheses_.push_back(std::move(hypothesis));
    most_similar_believed_ = -1;
    for (const PlaceHypothesis& t : hypotheses_) {
      if (t.said.confirmed && t.said.similarity > most_similar_believed_ &&
          !find_why_refused(options_, t, hypotheses_))
        most_similar_believed_ = t.said.similarity;
    }
  }

  /// Prefilters the keyframes that have not been examined, until `most` have been in all. Those of which some
  /// matches are supported wait for a closer look, those with most first.
  void prefilter(std::span<const Ranked> ranked, size_t most) {
    for (const Ranked& r : ranked) {
      if (asked_.size() >= most) break;
      const KeyframePose* pose = r.map->snapshot->find(r.indexed().id);
      if (pose == nullptr || was_asked(r.indexed())) continue;
      asked_.push_back(&r.indexed());
      Prefiltered prefiltered{r, pose,
                              run_prefilter(view_, cells_, *r.map, r.keyframe, options_.confirm.match)};
      if (prefiltered.prefilter.supported > 0) {
        waiting_.push_back(std::move(prefiltered));
      } else {
        verify(prefiltered);
      }
    }
    std::ranges::stable_sort(waiting_, std::greater(),
                             [](const Prefiltered& g) { return g.prefilter.supported; });
  }

  /// Looks closer at the keyframes that wait, until one is clear (returns true) or `most_poses` poses have
  /// been looked for in all.
  bool look_closer(size_t most_poses, Examine which = Examine::kOpenPlaces) {
    std::vector<Prefiltered> left;
    bool is_found = false;
    for (Prefiltered& g : waiting_) {
      const bool is_next = !is_found && is_worth_while(g, most_poses, which);
      if (!is_next) {
        left.push_back(std::move(g));
        continue;
      }
      const PlaceHypothesis& hypothesis = verify(g);
      poses_ += hypothesis.said.supported >= options_.confirm.min_supported ? 1 : 0;
      is_found = is_clear(hypothesis.said, options_) && !find_why_refused(options_, hypothesis, hypotheses_);
    }
    waiting_ = std::move(left);
    return is_found;
  }

  /// Whether a keyframe is looked at closer, given how many poses have been looked for. Where a place is
  /// believed, more of its rivals are looked at than where none is.
  [[nodiscard]] bool is_worth_while(const Prefiltered& g, size_t most_poses, Examine which) const {
    if (which == Examine::kAnyPlace || !is_any_confirmed()) return poses_ < most_poses;
    const IndexedKeyframe& keyframe = g.ranked.indexed();
    const MapId& map = g.ranked.map->snapshot->map;
    if (is_settled(keyframe, map)) return false;
    return poses_ < most_poses + (is_any_believed() ? options_.more_for_rivals : 0);
  }

  /// Settles the first hypothesis: searches for the best pose around its own. Returns whether it is still
  /// confirmed.
  bool settle_first() {
    PlaceHypothesis& first = hypotheses_.front();
    const Ranked& r = first.ranked;
    confirm_settled(view_, grid_, camera_, *r.map, r.keyframe, options_.confirm, &first.said);
    first.candidate = make_candidate(r, first.said, *r.map->snapshot->find(r.indexed().id));
    return first.said.confirmed;
  }

  const PlaceHypothesis& verify(const Prefiltered& g) {
    const Ranked& r = g.ranked;
    Confirmation said =
        confirm(view_, cells_, grid_, camera_, *r.map, r.keyframe, g.prefilter, options_.confirm);
    PlaceCandidate candidate = make_candidate(r, said, *g.pose);
    add({r, std::move(candidate), std::move(said), static_cast<double>(g.pose->mean_depth)});
    return hypotheses_.back();
  }

  const Camera& camera_;
  const PlaceView& view_;
  const RelocOptions& options_;
  CornerGrid grid_;
  std::vector<CellList> cells_;
  std::vector<const IndexedKeyframe*> asked_;
  std::vector<Prefiltered> waiting_;  ///< for a closer look, the most promising first
  size_t poses_ = 0;                  ///< number of poses that were looked for
  std::vector<PlaceHypothesis> hypotheses_;
  double most_similar_believed_ = -1;  ///< of those confirmed and not refused; -1: there is none
};

RelocalizationAnswer answer_as_paper(const PlaceIndex& index, const Camera& camera, const TinyImage& tiny) {
  RelocalizationAnswer result;
  const Ranked nearest = find_nearest(index, tiny);
  if (nearest.map == nullptr) {
    result.reason = kNothingToCompare;
    return result;
  }
  result.verdict = RelocalizationVerdict::kUnconfirmed;
  result.candidates.push_back(guess(nearest, camera, tiny));
  result.reason = result.candidates.front().reason;
  return result;
}

}  // namespace

RelocalizationAnswer relocalize(const PlaceIndex& index, const Camera& camera, const PlaceView& view,
                                const RelocOptions& options, const SearchScope& scope) {
  // From here on there are no other maps.
  if (!index.is_within(scope.maps))
    return relocalize(index.only(scope.maps), camera, view, options, {MapSet::all(), scope.first});
  const bool has_first = !scope.first.empty();
  const QueryImage query(TinyImage(view.small, kPlaceBlur));
  if (options.method == RelocMethod::kPaper) return answer_as_paper(index, camera, query.tiny);
  RelocalizationAnswer result;
  Inquiry inquiry(camera, view, options);
  if (!has_first || !inquiry.search(index.only(MapSet(scope.first)), query)) inquiry.search(index, query);
  const bool is_any_confirmed = inquiry.is_any_confirmed();
  result.candidates = inquiry.take_candidates();
  if (result.candidates.empty()) {
    result.reason = kNothingToCompare;
  } else if (result.candidates.front().confirmed) {
    result.verdict = RelocalizationVerdict::kConfirmed;
  } else if (is_any_confirmed) {
    result.reason = result.candidates.front().reason;
  } else {
    result.reason = fmt::format("none of the {} keyframes examined, of {}, agrees with the corners seen",
                                result.candidates.size(), index.keyframe_count());
  }
  const auto told = static_cast<size_t>(options.shortlist);
  if (result.candidates.size() > told) result.candidates.resize(told);
  return result;
}

}  // namespace cairn
