// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/image_forest.h"

#include <flann/algorithms/dist.h>
#include <flann/algorithms/kdtree_index.h>

#include <algorithm>
#include <utility>

namespace cairn {
namespace {

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

/// The nearest images that are still there, at most `count`. One that is gone takes no place among them.
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
    const ImageForest::Found found{distance, slots_[row]};
    const auto at = std::upper_bound(nearest_.begin(), nearest_.end(), found,
                                     [](const auto& a, const auto& b) { return a.distance < b.distance; });
    nearest_.insert(at, found);
    if (nearest_.size() > count_) nearest_.pop_back();
  }
  [[nodiscard]] std::vector<ImageForest::Found> take() { return std::move(nearest_); }

 private:
  size_t count_;
  std::span<const uint32_t> slots_;
  const std::function<bool(uint32_t slot)>& is_there_;
  std::vector<ImageForest::Found> nearest_;
};

}  // namespace

/// The trees of images of one size.
class ImageForest::Trees {
 public:
  Trees(std::vector<CompactImage> images, std::vector<uint32_t> slots, const ForestOptions& options)
      : images_(std::move(images)),
        slots_(std::move(slots)),
        checks_(options.checks),
        // FLANN keeps pointers to the rows and does not write to them.
        index_(flann::Matrix<float>(images_.front().values.data(), images_.size(), kCompactSize,
                                    sizeof(CompactImage)),
               flann::KDTreeIndexParams(options.trees)) {
    index_.buildIndex();
  }

  [[nodiscard]] bool has_size_of(const CompactImage& query) const {
    return is_comparable(query, images_.front());
  }
  [[nodiscard]] std::vector<Found> find(const CompactImage& query, size_t count,
                                        const std::function<bool(uint32_t slot)>& is_there) const {
    NearestThere nearest(std::min(count, images_.size()), slots_, is_there);
    index_.findNeighbors(nearest, query.values.data(), flann::SearchParams(checks_));
    return nearest.take();
  }
  [[nodiscard]] const std::vector<CompactImage>& images() const { return images_; }
  [[nodiscard]] size_t bytes() const {
    return images_.size() * (sizeof(CompactImage) + sizeof(uint32_t)) +
           static_cast<size_t>(index_.usedMemory());
  }

 private:
  std::vector<CompactImage> images_;
  std::vector<uint32_t> slots_;  ///< by row
  int checks_;
  flann::KDTreeIndex<Distance> index_;
};

ImageForest::ImageForest(std::span<const Image> images, const ForestOptions& options) {
  slots_.reserve(images.size());
  std::vector<uint32_t> by_size;
  for (const Image& p : images) {
    by_size.push_back(static_cast<uint32_t>(slots_.size()));
    slots_.push_back({p.map, p.keyframe});
  }
  const auto size_of = [&](uint32_t slot) {
    return std::pair(images[slot].compact.width, images[slot].compact.height);
  };
  std::stable_sort(by_size.begin(), by_size.end(),
                   [&](uint32_t a, uint32_t b) { return size_of(a) < size_of(b); });
  rows_.resize(slots_.size());
  for (auto begin = by_size.begin(); begin != by_size.end();) {
    const auto end =
        std::find_if(begin, by_size.end(), [&](uint32_t slot) { return size_of(slot) != size_of(*begin); });
    std::vector<CompactImage> rows;
    rows.reserve(static_cast<size_t>(end - begin));
    for (auto slot = begin; slot != end; ++slot) rows.push_back(images[*slot].compact);
    trees_.push_back(std::make_unique<const Trees>(std::move(rows), std::vector(begin, end), options));
    const CompactImage* row = trees_.back()->images().data();
    for (auto slot = begin; slot != end; ++slot) rows_[*slot] = row++;
    begin = end;
  }
}

ImageForest::~ImageForest() = default;

std::vector<ImageForest::Found> ImageForest::find(const CompactImage& query, size_t count,
                                                  const std::function<bool(uint32_t slot)>& is_there) const {
  for (const auto& trees : trees_) {
    if (trees->has_size_of(query)) return trees->find(query, count, is_there);
  }
  return {};
}

size_t ImageForest::bytes() const {
  size_t sum = slots_.size() * (sizeof(Slot) + sizeof(const CompactImage*));
  for (const auto& trees : trees_) sum += trees->bytes();
  return sum;
}

}  // namespace cairn
