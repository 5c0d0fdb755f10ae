// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/relocalizer.h"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace cairn {
namespace {

/// A keyframe of the index in the order of merit. Smaller cost is better.
struct Ranked {
  float cost = 0;
  const IndexedMap* map = nullptr;
  const IndexedKeyframe* keyframe = nullptr;
};

float root_mean_square(const TinyImage& image) {
  double sum = 0;
  for (const float v : image.values()) sum += static_cast<double>(v) * v;
  return image.empty() ? 0 : static_cast<float>(std::sqrt(sum / static_cast<double>(image.values().size())));
}

/// Pearson's correlation from the mean squared difference of two zero-mean images: indifferent to gain.
float correlation(float squared_difference, float contrast_a, float contrast_b) {
  const float product = 2 * contrast_a * contrast_b;
  if (!(product > 0)) return -1;
  return (contrast_a * contrast_a + contrast_b * contrast_b - squared_difference) / product;
}

/// The best `count` keyframes with a tiny image of the query's size, best first. The scan reads 5 kB per
/// keyframe and takes about a microsecond for each (README.md: it beats an index up to thousands).
std::vector<Ranked> rank(const PlaceIndex& index, const TinyImage& tiny, RelocMethod method, size_t count) {
  const float contrast = root_mean_square(tiny);
  std::vector<Ranked> ranked;
  ranked.reserve(index.keyframe_count());
  for (const IndexedMapPtr& map : index.maps()) {
    for (const IndexedKeyframePtr& keyframe : map->keyframes) {
      const float difference = tiny_difference(keyframe->tiny, tiny);
      if (!std::isfinite(difference)) continue;
      const float cost = method == RelocMethod::kPaper
                             ? difference
                             : 1 - correlation(difference, keyframe->contrast, contrast);
      ranked.push_back({cost, map.get(), keyframe.get()});
    }
  }
  const auto best = ranked.begin() + static_cast<ptrdiff_t>(std::min(count, ranked.size()));
  std::partial_sort(ranked.begin(), best, ranked.end(), [](const Ranked& a, const Ranked& b) {
    return std::tuple(a.cost, a.map->snapshot->map, a.keyframe->id) <
           std::tuple(b.cost, b.map->snapshot->map, b.keyframe->id);
  });
  ranked.erase(best, ranked.end());
  return ranked;
}

PlaceCandidate begin_candidate(const Ranked& ranked) {
  PlaceCandidate candidate;
  candidate.map = ranked.map->snapshot->map;
  candidate.epoch = ranked.map->snapshot->epoch;
  candidate.revision = ranked.map->snapshot->revision;
  candidate.keyframe = ranked.keyframe->id;
  return candidate;
}

/// The paper's answer: the nearest keyframe's pose, turned as the tiny images say.
PlaceCandidate guess(const Ranked& best, const Camera& camera, const TinyImage& tiny) {
  PlaceCandidate candidate = begin_candidate(best);
  candidate.score = best.cost;
  candidate.camera_from_keyframe =
      rotation_from_tiny(align_tiny(best.keyframe->tiny, tiny), camera, tiny.width());
  candidate.reason = "nearest tiny image, not verified";
  return candidate;
}

PlaceCandidate make_candidate(const Ranked& ranked, const Confirmation& said) {
  PlaceCandidate candidate = begin_candidate(ranked);
  candidate.score = 1 - ranked.cost;
  candidate.matches = said.agreeing;
  candidate.expected = said.expected;
  candidate.inliers = said.inliers;
  candidate.confirmed = said.confirmed;
  candidate.reason = said.reason;
  if (const KeyframePose* pose = ranked.map->snapshot->find(ranked.keyframe->id)) {
    candidate.camera_from_keyframe = said.camera_from_map * pose->camera_from_map.inverse();
  }
  return candidate;
}

/// So much that no other place can look better: the rest need not be tried.
bool is_clear(const Confirmation& said, const RelocOptions& options) {
  return said.confirmed && said.agreeing >= options.confirm.clear_agreeing &&
         said.alikeness >= options.confirm.clear_alikeness;
}

struct Tried {
  PlaceCandidate candidate;
  double alikeness = -1;
};

/// Confirmed first, by how alike the picture is: from one keyframe the pose may be worse than from another,
/// and inliers do not tell. The rest in the order they were tried.
std::vector<PlaceCandidate> in_order(std::vector<Tried> tried) {
  std::stable_sort(tried.begin(), tried.end(), [](const Tried& a, const Tried& b) {
    if (a.candidate.confirmed != b.candidate.confirmed) return a.candidate.confirmed;
    return a.candidate.confirmed && a.alikeness > b.alikeness;
  });
  std::vector<PlaceCandidate> candidates;
  candidates.reserve(tried.size());
  for (Tried& t : tried) candidates.push_back(std::move(t.candidate));
  return candidates;
}

}  // namespace

PlaceAnswer relocalize(const PlaceIndex& index, const Camera& camera, const PlaceView& view,
                       const RelocOptions& options) {
  PlaceAnswer result;
  const TinyImage tiny(view.small, kPlaceBlur);
  const std::vector<Ranked> ranked =
      rank(index, tiny, options.method, static_cast<size_t>(options.shortlist));
  if (ranked.empty()) {
    result.reason = "there is no keyframe to compare with";
    return result;
  }
  if (options.method == RelocMethod::kPaper) {
    result.verdict = PlaceVerdict::kUnconfirmed;
    result.candidates.push_back(guess(ranked.front(), camera, tiny));
    result.reason = result.candidates.front().reason;
    return result;
  }
  const CornerGrid grid(view, camera);
  std::vector<Tried> tried;
  for (const Ranked& r : ranked) {
    const Confirmation said = confirm(view, grid, camera, *r.map, *r.keyframe, options.confirm);
    tried.push_back({make_candidate(r, said), said.alikeness});
    if (is_clear(said, options)) break;
  }
  result.candidates = in_order(std::move(tried));
  if (result.candidates.front().confirmed) {
    result.verdict = PlaceVerdict::kConfirmed;
  } else {
    result.reason = fmt::format("none of the {} most similar keyframes of {} agrees with the corners seen",
                                result.candidates.size(), index.keyframe_count());
  }
  return result;
}

}  // namespace cairn
