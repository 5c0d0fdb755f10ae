// SPDX-License-Identifier: Apache-2.0
//
// Makes the words of vocabulary.h when the project is built, and prints them as C++. They are learned from
// made images, so that they know no recording and no map: dead leaves (Lee, Mumford and Huang, IJCV 2001),
// overlapping shapes whose sizes follow a power law, which have the statistics of edges and corners that
// images of things in front of each other have.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <vector>

#include "common/image/corners.h"
#include "common/image/place.h"
#include "server/relocalization/vocabulary.h"

namespace cairn {
namespace {

constexpr int kImages = 150;
constexpr int kWidth = 640;
constexpr int kHeight = 480;
constexpr int kBackgroundLeaves = 40;  ///< large ones that cover the image first
constexpr int kLeaves = 900;
constexpr double kSmallest = 3;   ///< [px] radius; density falls with its third power
constexpr double kLargest = 160;  ///< [px]
constexpr double kNoise = 2;      ///< [grey levels] standard deviation, of a camera
constexpr int kRounds = 6;        ///< of clustering

class Random {  // SplitMix64 (Steele et al., OOPSLA 2014)
 public:
  explicit Random(uint64_t seed) : state_(seed) {}
  uint64_t next() {
    uint64_t z = (state_ += 0x9E3779B97F4A7C15ULL);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
    return z ^ (z >> 31);
  }
  double uniform(double from, double to) {
    return from + (to - from) * static_cast<double>(next() >> 11) * 0x1.0p-53;
  }

 private:
  uint64_t state_;
};

/// A disc or a box, turned and squeezed, shaded from one side to the other.
void paint_leaf(double radius, Random* random, std::vector<float>* canvas) {
  const double x0 = random->uniform(0, kWidth);
  const double y0 = random->uniform(0, kHeight);
  const double angle = random->uniform(0, 2 * std::numbers::pi);
  const double c = std::cos(angle);
  const double s = std::sin(angle);
  const double squeeze = random->uniform(0.4, 1);
  const bool is_box = random->uniform(0, 1) < 0.5;
  const double grey = random->uniform(20, 235);
  const double shade_x = random->uniform(-15, 15) / radius;
  const double shade_y = random->uniform(-15, 15) / radius;
  const double reach = radius * std::numbers::sqrt2;
  const auto clamped = [](double v, int size) { return std::clamp(static_cast<int>(v), 0, size); };
  for (int y = clamped(y0 - reach, kHeight); y < clamped(y0 + reach, kHeight); ++y) {
    for (int x = clamped(x0 - reach, kWidth); x < clamped(x0 + reach, kWidth); ++x) {
      const double dx = x - x0;
      const double dy = y - y0;
      const double p = (c * dx + s * dy) / radius;
      const double q = (c * dy - s * dx) / (radius * squeeze);
      if (is_box ? std::max(std::abs(p), std::abs(q)) < 1 : p * p + q * q < 1)
        (*canvas)[static_cast<size_t>(y * kWidth + x)] =
            static_cast<float>(grey + shade_x * dx + shade_y * dy);
    }
  }
}

GrayImage make_image(Random* random) {
  std::vector<float> canvas(static_cast<size_t>(kWidth) * kHeight, 128);
  for (int i = 0; i < kBackgroundLeaves; ++i)
    paint_leaf(random->uniform(kLargest / 2, kLargest), random, &canvas);
  for (int i = 0; i < kLeaves; ++i) {
    const double inverse_square = random->uniform(1 / (kLargest * kLargest), 1 / (kSmallest * kSmallest));
    paint_leaf(1 / std::sqrt(inverse_square), random, &canvas);
  }
  GrayImage image(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      // The optics: the binomial [1 2 1]/4 in both directions.
      double sum = 0;
      for (int j = -1; j <= 1; ++j) {
        for (int i = -1; i <= 1; ++i) {
          const int at = std::clamp(y + j, 0, kHeight - 1) * kWidth + std::clamp(x + i, 0, kWidth - 1);
          sum += static_cast<double>((2 - std::abs(i)) * (2 - std::abs(j))) *
                 static_cast<double>(canvas[static_cast<size_t>(at)]);
        }
      }
      // Three uniform numbers are normal enough: variance 3/12.
      const double noise =
          2 * kNoise *
          (random->uniform(-1.5, 1.5) + random->uniform(-1.5, 1.5) + random->uniform(-1.5, 1.5)) / 3;
      image.row(y)[x] = static_cast<uint8_t>(std::clamp(std::lround(sum / 16 + noise), 0L, 255L));
    }
  }
  return image;
}

std::vector<Descriptor> describe_images() {
  Random random(2008);
  std::vector<Descriptor> descriptors;
  for (int i = 0; i < kImages; ++i) {
    const GrayImage image = make_image(&random);
    Pyramid pyramid;
    pyramid.build(image);
    for (const PlaceCorner& c : describe_place(pyramid, detect_corners(pyramid)).corners)
      descriptors.push_back(c.descriptor);
  }
  return descriptors;
}

/// The descriptor that has the bits that most of the members have: their median in Hamming distance.
Descriptor majority(std::span<const Descriptor> all, const std::vector<size_t>& members) {
  std::array<size_t, 256> set{};
  for (const size_t m : members) {
    for (size_t bit = 0; bit < set.size(); ++bit) set[bit] += all[m][bit / 64] >> (bit % 64) & 1;
  }
  Descriptor median{};
  for (size_t bit = 0; bit < set.size(); ++bit) {
    if (2 * set[bit] > members.size()) median[bit / 64] |= uint64_t{1} << (bit % 64);
  }
  return median;
}

std::vector<std::vector<size_t>> assign(std::span<const Descriptor> all,
                                        std::span<const Descriptor> centers) {
  std::vector<std::vector<size_t>> members(centers.size());
  for (size_t i = 0; i < all.size(); ++i)
    members[static_cast<size_t>(find_nearest(all[i], centers).index)].push_back(i);
  return members;
}

/// k-means in Hamming space (k-majority: Grana et al., 2013). A cluster that loses its members keeps its
/// centre.
std::vector<Descriptor> cluster(std::span<const Descriptor> all, size_t count, Random* random) {
  std::vector<Descriptor> centers;
  for (size_t i = 0; i < count; ++i) centers.push_back(all[random->next() % all.size()]);
  for (int round = 0; round < kRounds; ++round) {
    const auto members = assign(all, centers);
    for (size_t i = 0; i < count; ++i) {
      if (!members[i].empty()) centers[i] = majority(all, members[i]);
    }
  }
  return centers;
}

void print(const char* name, std::span<const Descriptor> descriptors) {
  std::printf("const std::array<Descriptor, %zu> %s = {{\n", descriptors.size(), name);
  for (const Descriptor& d : descriptors) {
    std::printf("{{0x%016lxU,0x%016lxU,0x%016lxU,0x%016lxU}},\n", d[0], d[1], d[2], d[3]);
  }
  std::printf("}};\n");
}

void make() {
  const std::vector<Descriptor> all = describe_images();
  Random random(2007);
  const std::vector<Descriptor> cells = cluster(all, kVocabularyCells, &random);
  std::vector<Descriptor> words;
  for (const auto& members : assign(all, cells)) {
    std::vector<Descriptor> of_cell;
    for (const size_t m : members) of_cell.push_back(all[m]);
    if (of_cell.empty()) of_cell.push_back(cells[words.size() / kWordsPerCell]);
    const auto of_words = cluster(of_cell, kWordsPerCell, &random);
    words.insert(words.end(), of_words.begin(), of_words.end());
  }
  std::printf("// Made by make_vocabulary.cpp.\n#include \"server/relocalization/vocabulary.h\"\n");
  std::printf("namespace cairn {\n");
  print("kCells", cells);
  print("kWords", words);
  std::printf("}  // namespace cairn\n");
}

}  // namespace
}  // namespace cairn

int main() {
  cairn::make();
}
