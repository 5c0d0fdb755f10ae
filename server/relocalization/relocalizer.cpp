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
#include "server/relocalization/votes.h"

namespace cairn {
namespace {

/// Length of the two orders of merit that are fused. Where pictures or words are led astray (other light) the
/// place is far down in both, yet at a like rank.
constexpr size_t kFused = 128;

/// Looking for a pose is most of what a closer look costs. So many are looked for in a search, so many more
/// where a place is believed, of its rivals, and then so many for the best pose there, unless the picture
/// looks so much alike from one of its keyframes.
constexpr size_t kMostPoses = 6;
constexpr size_t kMoreForRivals = 3;
constexpr size_t kMoreForPose = 2;
constexpr double kSureAlikeness = 0.65;

/// So many keyframes of a place that has been confirmed are tried, those included that a glance ruled out;
/// then others are, which may look as much like it.
constexpr int kTriesOfPlace = 3;

/// Where nothing is confirmed, so many neighbours of each keyframe that is half known are glanced at, and so
/// many in all.
constexpr size_t kNeighboursOfLead = 4;
constexpr size_t kTriesOfLeads = 4;

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
  if (said.camera_from_map)
    candidate.camera_from_keyframe = *said.camera_from_map * keyframe.camera_from_map.inverse();
  return candidate;
}

/// So much that no other place can look better: the rest need not be tried.
bool is_clear(const Confirmation& said, const RelocOptions& options) {
  return said.confirmed && !said.changed && said.agreeing >= options.confirm.clear_agreeing &&
         evidence(said) >= options.confirm.clear_evidence;
}

/// Believed first, by how alike the picture is: from one keyframe the pose may be worse than from another,
/// and inliers do not tell. Then what looks right and is common, then the rest, in the order they were tried.
void put_in_order(std::vector<Tried>* tried) {
  std::ranges::stable_sort(*tried, [](const Tried& a, const Tried& b) {
    if (a.candidate.confirmed != b.candidate.confirmed) return a.candidate.confirmed;
    if (a.said.confirmed != b.said.confirmed) return a.said.confirmed;
    return a.candidate.confirmed && a.said.alikeness > b.said.alikeness;
  });
}

/// A keyframe that was glanced at.
struct Glanced {
  Ranked ranked;
  const KeyframePose* pose;
  Glance glance;
};

/// Which keyframes are looked at closer: not those of a place of which enough have been, or these, too.
enum class Tries : uint8_t { kOfOpenPlaces, kOfAnyPlace };

/// One question on its way through the keyframes.
class Inquiry {
 public:
  Inquiry(const Camera& camera, const PlaceView& view, const RelocOptions& options)
      : camera_(camera), view_(view), options_(options), grid_(view, camera), cells_(probed_cells(view)) {}

  /// Tries the most promising keyframes of the index that have not been tried. True: one of them is clear.
  bool search(const PlaceIndex& index, const QueryPicture& picture) {
    const auto shortlist = static_cast<size_t>(options_.shortlist);
    const size_t before = asked_.size();
    const size_t most_poses = poses_ + kMostPoses;
    // Those of the maps searched before wait until these have been glanced at, too.
    std::vector<Glanced> before_these = std::exchange(waiting_, {});
    const NearPictures near(index, picture, options_.search);
    const auto alike = near.alike(shortlist);
    for (size_t n = 1; n <= static_cast<size_t>(options_.by_picture_alone); ++n) {
      glance(alike, before + n);
      if (look_closer(most_poses)) return true;
    }
    std::ranges::move(before_these, std::back_inserter(waiting_));
    const auto voted = vote(index, near.maps(), view_, cells_, kFused);
    glance(fuse(near.alike(kFused), voted, picture), before + shortlist);
    if (look_closer(most_poses)) return true;
    if (!is_any_confirmed() && follow_leads(picture, most_poses)) return true;
    return is_any_believed() && most_alike_believed_ < kSureAlikeness &&
           look_closer(poses_ + kMoreForPose, Tries::kOfAnyPlace);
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
    put_in_order(&tried_);
    while (!tried_.empty() && tried_.front().candidate.confirmed && !settle_first()) put_in_order(&tried_);
    std::vector<PlaceCandidate> candidates;
    candidates.reserve(tried_.size());
    for (Tried& t : tried_) candidates.push_back(std::move(t.candidate));
    return candidates;
  }

 private:
  /// Whether a place is confirmed and not refused for what others show.
  [[nodiscard]] bool is_any_believed() const { return most_alike_believed_ >= 0; }

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
  /// tried. Nothing is glanced at that could not be looked at closer. True: one is clear.
  bool follow_leads(const QueryPicture& picture, size_t most_poses) {
    const size_t most = asked_.size() + kTriesOfLeads;
    for (const Ranked& lead : leads()) {
      if (asked_.size() >= most || poses_ >= most_poses) return false;
      glance(neighbours_of(lead, picture), most);
      if (look_closer(most_poses)) return true;
    }
    return false;
  }

  /// Counts it among what was tried of its place. It may be a rival of any that were believed.
  void add(Tried tried) {
    for (Tried& before : tried_) {
      if (!is_of_place(before.ranked.indexed(), before.candidate.map, tried)) continue;
      ++before.tries_of_place;
      ++tried.tries_of_place;
    }
    tried_.push_back(std::move(tried));
    most_alike_believed_ = -1;
    for (const Tried& t : tried_) {
      if (t.said.confirmed && t.said.alikeness > most_alike_believed_ &&
          !find_why_refused(options_, t, tried_))
        most_alike_believed_ = t.said.alikeness;
    }
  }

  /// Glances at the keyframes that have not been asked about, until `most` have been in all. Those that show
  /// something of the picture wait for a closer look, most of it first.
  void glance(std::span<const Ranked> ranked, size_t most) {
    for (const Ranked& r : ranked) {
      if (asked_.size() >= most) break;
      const KeyframePose* pose = r.map->snapshot->find(r.indexed().id);
      if (pose == nullptr || was_asked(r.indexed())) continue;
      asked_.push_back(&r.indexed());
      Glanced glanced{r, pose, glance_at(view_, cells_, *r.map, r.keyframe)};
      if (glanced.glance.supported > 0) {
        waiting_.push_back(std::move(glanced));
      } else {
        try_out(glanced);
      }
    }
    std::ranges::stable_sort(waiting_, std::greater(), [](const Glanced& g) { return g.glance.supported; });
  }

  /// Looks closer at those that wait, until one is clear (true) or so many poses have been looked for in all.
  bool look_closer(size_t most_poses, Tries tries = Tries::kOfOpenPlaces) {
    std::vector<Glanced> left;
    bool is_found = false;
    for (Glanced& g : waiting_) {
      const bool is_next = !is_found && is_worth_while(g, most_poses, tries);
      if (!is_next) {
        left.push_back(std::move(g));
        continue;
      }
      const Tried& tried = try_out(g);
      poses_ += tried.said.supported >= options_.confirm.min_supported ? 1 : 0;
      is_found = is_clear(tried.said, options_) && !find_why_refused(options_, tried, tried_);
    }
    waiting_ = std::move(left);
    return is_found;
  }

  /// Where a place is believed, more of its rivals are looked at than where none is.
  [[nodiscard]] bool is_worth_while(const Glanced& g, size_t most_poses, Tries tries) const {
    if (tries == Tries::kOfAnyPlace || !is_any_confirmed()) return poses_ < most_poses;
    const IndexedKeyframe& keyframe = g.ranked.indexed();
    const MapId& map = g.ranked.map->snapshot->map;
    if (is_settled(keyframe, map)) return false;
    return poses_ < most_poses + (is_any_believed() ? kMoreForRivals : 0);
  }

  /// The first of those in order has the best pose that is found around it. Whether it is still confirmed.
  bool settle_first() {
    Tried& first = tried_.front();
    const Ranked& r = first.ranked;
    confirm_settled(view_, grid_, camera_, *r.map, r.keyframe, options_.confirm, &first.said);
    first.candidate = make_candidate(r, first.said, *r.map->snapshot->find(r.indexed().id));
    return first.said.confirmed;
  }

  const Tried& try_out(const Glanced& g) {
    const Ranked& r = g.ranked;
    Confirmation said =
        confirm(view_, cells_, grid_, camera_, *r.map, r.keyframe, g.glance, options_.confirm);
    PlaceCandidate candidate = make_candidate(r, said, *g.pose);
    add({r, std::move(candidate), std::move(said), static_cast<double>(g.pose->mean_depth)});
    return tried_.back();
  }

  const Camera& camera_;
  const PlaceView& view_;
  const RelocOptions& options_;
  CornerGrid grid_;
  std::vector<CellList> cells_;
  std::vector<const IndexedKeyframe*> asked_;
  std::vector<Glanced> waiting_;  ///< for a closer look, the most promising first
  size_t poses_ = 0;              ///< that were looked for
  std::vector<Tried> tried_;
  double most_alike_believed_ = -1;  ///< of those confirmed and not refused; -1: there is none
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
  // From here on there are no other maps.
  if (!index.is_within(scope.maps))
    return relocalize(index.only(scope.maps), camera, view, options, {MapSet::all(), scope.first});
  const bool has_first = !scope.first.empty();
  const QueryPicture picture(TinyImage(view.small, kPlaceBlur));
  if (options.method == RelocMethod::kPaper) return answer_as_paper(index, camera, picture.tiny);
  PlaceAnswer result;
  Inquiry inquiry(camera, view, options);
  if (!has_first || !inquiry.search(index.only(MapSet(scope.first)), picture)) inquiry.search(index, picture);
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
