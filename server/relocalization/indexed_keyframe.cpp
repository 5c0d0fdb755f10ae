// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/indexed_keyframe.h"

#include <algorithm>
#include <numeric>
#include <span>
#include <tuple>
#include <utility>

#include "server/relocalization/compact.h"
#include "server/relocalization/described_scale.h"

namespace cairn {
namespace {

constexpr float kLeastMoreWhite = 0.01F;  ///< share of the image that is clipped only when overexposed

/// Tells which of a keyframe's measurements are known from `previous`, the keyframe as it was indexed before:
/// those of the same point at the same pixel and level.
class Known {
 public:
  /// `previous`: null, or outlives it.
  Known(const IndexedKeyframe* previous, std::span<const PointMeasurement> measurements)
      : previous_(previous), was_(measurements.size()) {
    if (previous == nullptr) return;
    for (size_t i = 0, o = 0; i < measurements.size(); ++i) {
      const PointMeasurement& m = measurements[i];
      while (o < previous->measured.size() && previous->measured[o] < m.id) ++o;
      if (o == previous->measured.size()) break;
      const Sighting& before = previous->sightings[o];
      if (previous->measured[o] == m.id && before.level == m.level && before.pixel == m.pixel) was_[i] = o;
    }
  }
  [[nodiscard]] const IndexedKeyframe* previous() const { return previous_; }
  /// Index of the measurement in `previous`; nothing if it is new, or was elsewhere.
  [[nodiscard]] std::optional<size_t> was(size_t measurement) const { return was_[measurement]; }

  [[nodiscard]] bool is_all() const {
    return std::ranges::all_of(was_, [](const auto& was) { return was.has_value(); });
  }

 private:
  const IndexedKeyframe* previous_;
  std::vector<std::optional<size_t>> was_;
};

struct Described {
  DescribedPoint point;
  Descriptor descriptor{};
  CellId cell = 0;
};

/// Vocabulary cells of the descriptors of `points`, in their order.
std::vector<CellId> cells_of(const DescribedPoints& points) {
  std::vector<CellId> cells(points.points.size());
  for (size_t cell = 0; cell < kVocabularyCells; ++cell) {
    const uint32_t* begin = &points.begin_of[cell * kPlaceScales];
    std::fill(cells.begin() + begin[0], cells.begin() + begin[kPlaceScales], static_cast<CellId>(cell));
  }
  return cells;
}

/// Descriptions of the known measurements, taken from `before`, in no particular order.
std::vector<Described> take_over(const DescribedPoints& before, const Known& known, size_t measurements) {
  const std::vector<CellId> cells = cells_of(before);
  std::vector<Described> described;
  for (uint32_t i = 0; i < measurements; ++i) {
    const auto was = known.was(i);
    if (!was) continue;
    for (uint8_t d = 0; d < known.previous()->sightings[*was].descriptions; ++d) {
      const uint32_t at = before.of_measured[*was][d];
      Described& taken =
          described.emplace_back(Described{before.points[at], before.descriptors[at], cells[at]});
      taken.point.measured = i;
    }
  }
  return described;
}

/// Describes the measurements that are not known, at both of their scales, and appends the result.
void describe_new(const Pyramid& pyramid, std::span<const PointMeasurement> measurements, const Known& known,
                  std::vector<Described>* described) {
  std::array<std::vector<uint32_t>, kPyramidLevels> fresh;
  for (uint32_t i = 0; i < measurements.size(); ++i) {
    if (!known.was(i)) fresh[measurements[i].level].push_back(i);
  }
  for (int scale = 0; scale < kPlaceScales; ++scale) {
    const int level = scale / 2;
    const std::vector<uint32_t>& here = fresh[static_cast<size_t>(level)];
    DescribedScale image(pyramid.level(level), scale % 2 != 0, here.size());
    for (const uint32_t i : here) {
      const PointMeasurement& m = measurements[i];
      Described d;
      const Eigen::Vector2f pixel(to_level(m.pixel.x(), level), to_level(m.pixel.y(), level));
      if (!image.describe(pixel, &d.descriptor)) continue;
      d.point = {i, static_cast<uint8_t>(scale)};
      d.cell = cell_of(d.descriptor);
      described->push_back(d);
    }
  }
}

DescribedPoints arrange(std::vector<Described> described, size_t measurements) {
  std::sort(described.begin(), described.end(), [](const Described& a, const Described& b) {
    return std::tuple(a.cell, a.point.scale, a.point.measured) <
           std::tuple(b.cell, b.point.scale, b.point.measured);
  });
  DescribedPoints points;
  points.points.reserve(described.size());
  points.descriptors.reserve(described.size());
  points.of_measured.resize(measurements);
  std::vector<size_t> count(measurements);
  for (const Described& d : described) {
    const uint32_t i = d.point.measured;
    points.of_measured[i][count[i]++] = static_cast<uint32_t>(points.points.size());
    points.points.push_back(d.point);
    points.descriptors.push_back(d.descriptor);
    ++points.begin_of[size_t{d.cell} * kPlaceScales + d.point.scale + 1];
  }
  std::partial_sum(points.begin_of.begin(), points.begin_of.end(), points.begin_of.begin());
  return points;
}

/// Describes all measurements. `before`: descriptions of those that are known; null: none is.
DescribedPoints describe_points(const Pyramid& pyramid, std::span<const PointMeasurement> measurements,
                                const Known& known, const DescribedPoints* before) {
  std::vector<Described> described;
  if (before != nullptr) described = take_over(*before, known, measurements.size());
  describe_new(pyramid, measurements, known, &described);
  DescribedPoints points = arrange(std::move(described), measurements.size());
  points.white = white_share(pyramid.level(kPyramidLevels - 1));
  return points;
}

/// The image as the camera would have taken it at kOverexposure times the exposure.
Pyramid overexpose(const GrayView& image) {
  GrayImage lit(image.width, image.height);
  for (int y = 0; y < image.height; ++y) {
    std::transform(image.row(y), image.row(y) + image.width, lit.row(y), [](uint8_t grey) {
      return static_cast<uint8_t>(std::min(kOverexposure * int{grey}, 255));
    });
  }
  Pyramid pyramid;
  pyramid.build(lit);
  return pyramid;
}

std::optional<DescribedPoints> describe_overexposed(const KeyframeView& view, const Known& known,
                                                    float white_as_taken) {
  const IndexedKeyframe* previous = known.previous();
  if (previous != nullptr && !previous->overexposed) return std::nullopt;
  if (previous != nullptr && known.is_all()) {
    const size_t measurements = view.measurements.size();
    DescribedPoints points = arrange(take_over(*previous->overexposed, known, measurements), measurements);
    points.white = previous->overexposed->white;
    return points;
  }
  const Pyramid lit = overexpose(view.pyramid->level(0));
  if (white_share(lit.level(kPyramidLevels - 1)) < white_as_taken + kLeastMoreWhite) return std::nullopt;
  return describe_points(lit, view.measurements, known,
                         previous != nullptr ? &*previous->overexposed : nullptr);
}

std::vector<WordId> find_words(const DescribedPoints& points) {
  const std::vector<CellId> cells = cells_of(points);
  std::vector<WordId> words;
  words.reserve(cells.size());
  for (size_t i = 0; i < cells.size(); ++i) words.push_back(word_in(cells[i], points.descriptors[i]));
  std::sort(words.begin(), words.end());
  words.erase(std::unique(words.begin(), words.end()), words.end());
  return words;
}

/// Sightings of the keyframe's measurements. `points` say how many descriptions each has.
std::vector<Sighting> make_sightings(const KeyframeView& view, const DescribedPoints& points) {
  const GrayView small = view.pyramid->level(kPyramidLevels - 1);
  std::vector<Sighting> sightings;
  sightings.reserve(view.measurements.size());
  for (const PointMeasurement& m : view.measurements)
    sightings.push_back({m.pixel, brightness_at(small, m.pixel), m.level, 0});
  for (const DescribedPoint& p : points.points) ++sightings[p.measured].descriptions;
  return sightings;
}

}  // namespace

const DescribedPoints& IndexedKeyframe::exposed_as(float white) const {
  if (!overexposed) return as_taken;
  return white - as_taken.white <= overexposed->white - white ? as_taken : *overexposed;
}

IndexedKeyframePtr index_keyframe(const KeyframeView& view, const IndexedKeyframe* previous) {
  auto indexed = std::make_shared<IndexedKeyframe>();
  indexed->id = view.id;
  indexed->camera = view.camera;
  indexed->tiny.assign(view.pyramid->level(kPyramidLevels - 1), kPlaceBlur);
  if (previous != nullptr && previous->tiny.values() != indexed->tiny.values()) previous = nullptr;
  const Known known(previous, view.measurements);
  indexed->contrast = contrast_of(indexed->tiny);
  indexed->measured.reserve(view.measurements.size());
  for (const PointMeasurement& m : view.measurements) indexed->measured.push_back(m.id);
  indexed->as_taken = describe_points(*view.pyramid, view.measurements, known,
                                      previous != nullptr ? &previous->as_taken : nullptr);
  indexed->overexposed = describe_overexposed(view, known, indexed->as_taken.white);
  indexed->words = find_words(indexed->as_taken);
  indexed->sightings = make_sightings(view, indexed->as_taken);
  return indexed;
}

}  // namespace cairn
