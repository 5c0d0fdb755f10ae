// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/picture_forest.h"

#include <flann/algorithms/dist.h>
#include <flann/algorithms/kdtree_index.h>

#include <algorithm>
#include <utility>

namespace cairn {
namespace {

constexpr int kTrees = 4;
constexpr int kChecks = 4096;  ///< pictures compared before a search ends (recall and time: tests/bench)

/// compact_distance() as FLANN wants it.
struct Distance {
  using is_kdtree_distance = bool;
  using ElementType = float;
  using ResultType = float;
  template <typename A, typename B>
  float operator()(A a, B b, size_t /*size*/) const {
    return compact_distance(a, b, std::numeric_limits<float>::infinity());
  }
  template <typename A, typename B>
  float accum_dist(const A& a, const B& b, int /*dimension*/) const {
    return (a - b) * (a - b);
  }
};

/// The `count` nearest, at most, that are there. One that is gone does not take the place of one that is not.
class NearestThere : public flann::ResultSet<float> {
 public:
  NearestThere(size_t count, std::span<const uint32_t> slots,
               const std::function<bool(uint32_t slot)>& is_there)
      : count_(count), slots_(slots), is_there_(is_there) {
    nearest_.reserve(count + 1);
  }

  [[nodiscard]] bool full() const override { return nearest_.size() == count_; }
  [[nodiscard]] float worstDist() const override {
    return full() ? nearest_.back().distance : std::numeric_limits<float>::max();
  }
  void addPoint(float distance, size_t row) override {
    if (distance >= worstDist() || !is_there_(slots_[row])) return;
    const PictureForest::Found found{distance, slots_[row]};
    const auto at = std::upper_bound(nearest_.begin(), nearest_.end(), found,
                                     [](const auto& a, const auto& b) { return a.distance < b.distance; });
    nearest_.insert(at, found);
    if (nearest_.size() > count_) nearest_.pop_back();
  }
  [[nodiscard]] std::vector<PictureForest::Found> take() { return std::move(nearest_); }

 private:
  size_t count_;
  std::span<const uint32_t> slots_;
  const std::function<bool(uint32_t slot)>& is_there_;
  std::vector<PictureForest::Found> nearest_;
};

}  // namespace

/// Of pictures of one size.
class PictureForest::Trees {
 public:
  Trees(std::vector<CompactPicture> pictures, std::vector<uint32_t> slots)
      : pictures_(std::move(pictures)),
        slots_(std::move(slots)),
        // FLANN keeps pointers to the rows and does not write to them.
        index_(flann::Matrix<float>(pictures_.front().values.data(), pictures_.size(), kCompactSize,
                                    sizeof(CompactPicture)),
               flann::KDTreeIndexParams(kTrees)) {
    index_.buildIndex();
  }

  [[nodiscard]] bool has_size_of(const CompactPicture& query) const {
    return is_comparable(query, pictures_.front());
  }
  [[nodiscard]] std::vector<Found> find(const CompactPicture& query, size_t count,
                                        const std::function<bool(uint32_t slot)>& is_there) const {
    NearestThere nearest(std::min(count, pictures_.size()), slots_, is_there);
    index_.findNeighbors(nearest, query.values.data(), flann::SearchParams(kChecks));
    return nearest.take();
  }
  [[nodiscard]] const std::vector<CompactPicture>& pictures() const { return pictures_; }
  [[nodiscard]] size_t bytes() const {
    return pictures_.size() * (sizeof(CompactPicture) + sizeof(uint32_t)) +
           static_cast<size_t>(index_.usedMemory());
  }

 private:
  std::vector<CompactPicture> pictures_;
  std::vector<uint32_t> slots_;  ///< by row
  flann::KDTreeIndex<Distance> index_;
};

PictureForest::PictureForest(std::span<const Picture> pictures) {
  slots_.reserve(pictures.size());
  std::vector<uint32_t> by_size;
  for (const Picture& p : pictures) {
    by_size.push_back(static_cast<uint32_t>(slots_.size()));
    slots_.push_back({p.map, p.keyframe});
  }
  const auto size_of = [&](uint32_t slot) {
    return std::pair(pictures[slot].compact.width, pictures[slot].compact.height);
  };
  std::stable_sort(by_size.begin(), by_size.end(),
                   [&](uint32_t a, uint32_t b) { return size_of(a) < size_of(b); });
  rows_.resize(slots_.size());
  for (auto begin = by_size.begin(); begin != by_size.end();) {
    const auto end =
        std::find_if(begin, by_size.end(), [&](uint32_t slot) { return size_of(slot) != size_of(*begin); });
    std::vector<CompactPicture> rows;
    rows.reserve(static_cast<size_t>(end - begin));
    for (auto slot = begin; slot != end; ++slot) rows.push_back(pictures[*slot].compact);
    trees_.push_back(std::make_unique<const Trees>(std::move(rows), std::vector(begin, end)));
    const CompactPicture* row = trees_.back()->pictures().data();
    for (auto slot = begin; slot != end; ++slot) rows_[*slot] = row++;
    begin = end;
  }
}

PictureForest::~PictureForest() = default;

std::vector<PictureForest::Found> PictureForest::find(
    const CompactPicture& query, size_t count, const std::function<bool(uint32_t slot)>& is_there) const {
  for (const auto& trees : trees_) {
    if (trees->has_size_of(query)) return trees->find(query, count, is_there);
  }
  return {};
}

size_t PictureForest::bytes() const {
  size_t sum = slots_.size() * (sizeof(Slot) + sizeof(const CompactPicture*));
  for (const auto& trees : trees_) sum += trees->bytes();
  return sum;
}

}  // namespace cairn
