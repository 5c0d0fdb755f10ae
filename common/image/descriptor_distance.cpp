// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <bit>
#include <limits>

#include "common/image/descriptor.h"
#include "common/image/kernels.h"

/// Distances of descriptors: by population count of whole vectors, of words, or as the compiler makes it.
namespace cairn {
namespace {

CAIRN_COUNT_WORDS inline int distance_by_words(const Descriptor& a, const Descriptor& b) {
  return different_bits_by_words(a.data(), b.data());
}

CAIRN_COUNT_VECTORS inline int distance_by_vectors(const Descriptor& a, const Descriptor& b) {
  return different_bits_by_vectors(a.data(), b.data());
}

using Distance = int (*)(const Descriptor&, const Descriptor&);

template <Distance kDistance>
CAIRN_INLINE void measure_all(const Descriptor& query, std::span<const Descriptor> set, uint16_t* out) {
  for (const Descriptor& d : set) *out++ = static_cast<uint16_t>(kDistance(query, d));
}

template <Distance kDistance>
CAIRN_INLINE NearestDescriptor scan(const Descriptor& query, std::span<const Descriptor> set) {
  NearestDescriptor nearest;
  for (size_t i = 0; i < set.size(); ++i) {
    const int distance = kDistance(query, set[i]);
    if (distance >= nearest.second_distance) continue;
    if (distance < nearest.distance) {
      nearest.second_distance = nearest.distance;
      nearest.distance = distance;
      nearest.index = static_cast<int>(i);
    } else {
      nearest.second_distance = distance;
    }
  }
  return nearest;
}

/// Writes the distances of all descriptors in the ranges to `out`, in their order; `out` has room for them.
/// Returns the least of them.
template <Distance kDistance>
CAIRN_INLINE int measure_ranges(const Descriptor& query, std::span<const Descriptor> set,
                                std::span<const IndexRange> ranges, NearDescriptor* out) {
  int least = std::numeric_limits<int>::max();
  for (const IndexRange& range : ranges) {
    for (uint32_t i = range.begin; i < range.end; ++i) {
      const int distance = kDistance(query, set[i]);
      *out++ = {i, distance};
      least = std::min(least, distance);
    }
  }
  return least;
}

/// The functions for one kind of machine. Each takes a copy of the query, so that it stays in registers.
struct Variant {
  void (*all)(Descriptor query, std::span<const Descriptor> set, uint16_t* out);
  NearestDescriptor (*nearest)(Descriptor query, std::span<const Descriptor> set);
  int (*ranges)(Descriptor query, std::span<const Descriptor> set, std::span<const IndexRange> ranges,
                NearDescriptor* out);
};

constexpr Variant kPlain = {
    [](Descriptor q, std::span<const Descriptor> set, uint16_t* out) {
      measure_all<descriptor_distance>(q, set, out);
    },
    [](Descriptor q, std::span<const Descriptor> set) { return scan<descriptor_distance>(q, set); },
    [](Descriptor q, std::span<const Descriptor> set, std::span<const IndexRange> ranges,
       NearDescriptor* out) { return measure_ranges<descriptor_distance>(q, set, ranges, out); },
};

constexpr Variant kByWords = {
    [](Descriptor q, std::span<const Descriptor> set, uint16_t* out)
        CAIRN_COUNT_WORDS { measure_all<distance_by_words>(q, set, out); },
    [](Descriptor q, std::span<const Descriptor> set)
        CAIRN_COUNT_WORDS { return scan<distance_by_words>(q, set); },
    [](Descriptor q, std::span<const Descriptor> set, std::span<const IndexRange> ranges, NearDescriptor* out)
        CAIRN_COUNT_WORDS { return measure_ranges<distance_by_words>(q, set, ranges, out); },
};

constexpr Variant kByVectors = {
    [](Descriptor q, std::span<const Descriptor> set, uint16_t* out)
        CAIRN_COUNT_VECTORS { measure_all<distance_by_vectors>(q, set, out); },
    [](Descriptor q, std::span<const Descriptor> set)
        CAIRN_COUNT_VECTORS { return scan<distance_by_vectors>(q, set); },
    [](Descriptor q, std::span<const Descriptor> set, std::span<const IndexRange> ranges, NearDescriptor* out)
        CAIRN_COUNT_VECTORS { return measure_ranges<distance_by_vectors>(q, set, ranges, out); },
};

const Variant& variant(Simd simd) {
  if (takes_wide(simd) && can_count_vectors()) return kByVectors;
  return simd != Simd::kScalar && can_count_words() ? kByWords : kPlain;
}

}  // namespace

int descriptor_distance(const Descriptor& a, const Descriptor& b) {
  int distance = 0;
  for (size_t i = 0; i < a.size(); ++i) distance += std::popcount(a[i] ^ b[i]);
  return distance;
}

void kernels::descriptor_distances(const Descriptor& query, std::span<const Descriptor> set, uint16_t* out,
                                   Simd simd) {
  variant(simd).all(query, set, out);
}

NearestDescriptor kernels::find_nearest(const Descriptor& query, std::span<const Descriptor> set, Simd simd) {
  return variant(simd).nearest(query, set);
}

void kernels::find_nearest_few(const Descriptor& query, std::span<const Descriptor> set,
                               std::span<const IndexRange> ranges, int limit, float ratio,
                               std::vector<NearDescriptor>* out, Simd simd) {
  const size_t before = out->size();
  size_t all = before;
  for (const IndexRange& range : ranges) all += range.end - range.begin;
  out->resize(all);
  const int least = variant(simd).ranges(query, set, ranges, out->data() + before);
  size_t kept = before;
  if (least <= limit) {
    const int farthest = farthest_within_ratio(least, ratio);
    // Nobody could foretell which are kept: all are written, and no branch is taken for any.
    for (size_t i = before; i < all; ++i) {
      const NearDescriptor near = (*out)[i];
      (*out)[kept] = near;
      kept += near.distance <= farthest ? 1 : 0;
    }
  }
  out->resize(kept);
}

void descriptor_distances(const Descriptor& query, std::span<const Descriptor> set, uint16_t* out) {
  kernels::descriptor_distances(query, set, out, best_simd());
}

NearestDescriptor find_nearest(const Descriptor& query, std::span<const Descriptor> set) {
  return kernels::find_nearest(query, set, best_simd());
}

void find_nearest_few(const Descriptor& query, std::span<const Descriptor> set,
                      std::span<const IndexRange> ranges, int limit, float ratio,
                      std::vector<NearDescriptor>* out) {
  kernels::find_nearest_few(query, set, ranges, limit, ratio, out, best_simd());
}

}  // namespace cairn
