// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/votes.h"

#include <algorithm>
#include <cmath>
#include <tuple>

namespace cairn {
namespace {

constexpr double kVoteUnit = 256;  ///< of the integer sums, per unit of the logarithm

struct WordCount {
  WordId word = 0;
  uint32_t corners = 0;
};

std::vector<WordCount> words_of(const PlaceView& view, std::span<const CellList> cells, size_t voting) {
  std::vector<WordId> all;
  all.reserve(voting * view.corners.size());
  for (size_t i = 0; i < view.corners.size(); ++i) {
    for (size_t k = 0; k < voting; ++k) all.push_back(word_in(cells[i][k], view.corners[i].descriptor));
  }
  std::sort(all.begin(), all.end());
  std::vector<WordCount> counts;
  for (const WordId word : all) {
    if (counts.empty() || counts.back().word != word) counts.push_back({word, 0});
    ++counts.back().corners;
  }
  return counts;
}

/// Weight of each word's vote, in whole units; 0: no keyframe shows it.
std::vector<uint32_t> weigh(const PlaceIndex& index, std::span<const WordCount> words) {
  const auto keyframes = static_cast<double>(index.keyframe_count());
  std::vector<uint32_t> weights;
  weights.reserve(words.size());
  for (const WordCount& w : words) {
    const uint32_t shown = index.shown(w.word);
    const double rarity = shown == 0 ? 0 : std::log(1 + keyframes / shown);
    weights.push_back(
        static_cast<uint32_t>(std::lround(kVoteUnit * rarity * std::sqrt(static_cast<double>(w.corners)))));
  }
  return weights;
}

/// Weight that a keyframe gets by chance for each word that it shows: the mean over all that keyframes show.
float chance_of(const PlaceIndex& index, std::span<const WordCount> words,
                std::span<const uint32_t> weights) {
  uint64_t sum = 0;
  for (size_t i = 0; i < words.size(); ++i) sum += uint64_t{weights[i]} * index.shown(words[i].word);
  return static_cast<float>(sum) / static_cast<float>(std::max<uint64_t>(1, index.shown_in_all()));
}

}  // namespace

std::vector<Voted> vote(const PlaceIndex& index, std::span<const IndexedMap* const> maps,
                        const PlaceView& view, std::span<const CellList> cells, size_t count,
                        const VoteOptions& options) {
  const std::vector<WordCount> words = words_of(view, cells, options.cells);
  const std::vector<uint32_t> weights = weigh(index, words);
  const float chance = chance_of(index, words, weights);
  std::vector<Voted> voted;
  std::vector<uint32_t> sums;
  for (const IndexedMap* map : maps) {
    sums.assign(map->keyframes.size(), 0);
    for (size_t i = 0; i < words.size(); ++i) {
      for (const uint32_t k : map->lists.of(words[i].word)) sums[k] += weights[i];
    }
    for (size_t k = 0; k < sums.size(); ++k) {
      if (sums[k] == 0) continue;
      const auto shown = static_cast<float>(map->keyframes[k]->words.size());
      voted.push_back({(static_cast<float>(sums[k]) - chance * shown) / std::sqrt(shown), map, k});
    }
  }
  const auto end = voted.begin() + static_cast<ptrdiff_t>(std::min(count, voted.size()));
  std::partial_sort(voted.begin(), end, voted.end(), [](const Voted& a, const Voted& b) {
    return std::tuple(-a.score, a.map->snapshot->map, a.keyframe) <
           std::tuple(-b.score, b.map->snapshot->map, b.keyframe);
  });
  voted.erase(end, voted.end());
  return voted;
}

}  // namespace cairn
