// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/picture_forest.h"

#include <flann/algorithms/dist.h>
#include <flann/algorithms/kdtree_index.h>

#include <algorithm>

namespace cairn {
namespace {

constexpr int kTrees = 4;
/// Pictures compared before a search ends: recall of the ten nearest 0.95 and more from 1 000 to 100 000
/// (tests/bench/README.md).
constexpr int kChecks = 256;

using Index = flann::KDTreeIndex<flann::L2_Simple<float>>;

}  // namespace

struct PictureForest::Trees {
  explicit Trees(std::vector<Compact> all)
      : pictures(std::move(all)),
        index(flann::Matrix<float>(pictures.front().data(), pictures.size(), kCompactSize),
              flann::KDTreeIndexParams(kTrees)) {
    index.buildIndex();
  }
  std::vector<Compact> pictures;
  Index index;
};

PictureForest::PictureForest(std::vector<Compact> pictures) {
  if (!pictures.empty()) trees_ = std::make_unique<Trees>(std::move(pictures));
}
PictureForest::~PictureForest() = default;

size_t PictureForest::size() const { return trees_ ? trees_->pictures.size() : 0; }

void PictureForest::find(const Compact& query, size_t count, std::vector<uint32_t>* out) const {
  out->clear();
  count = std::min(count, size());
  if (count == 0) return;
  flann::KNNResultSet<float> nearest(count);
  flann::SearchParams parameters(kChecks);
  trees_->index.findNeighbors(nearest, query.data(), parameters);
  std::vector<size_t> indices(nearest.size());
  std::vector<float> distances(nearest.size());
  nearest.copy(indices.data(), distances.data(), indices.size(), true);
  out->assign(indices.begin(), indices.end());
}

}  // namespace cairn
