// SPDX-License-Identifier: Apache-2.0
#include "client/capture/image_sample.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <map>
#include <numeric>

#include "common/io/image_header.h"
#include "common/io/orientation.h"
#include "common/io/text.h"

namespace cairn {
namespace {

constexpr size_t kImages = 9;
constexpr size_t kValues = 65536;
constexpr int kAllBits = 16;
constexpr int kLeastBits = 8;     ///< of a mapping: fewer would show noise
constexpr double kFaults = 1e-3;  ///< of the pixels, at either end
constexpr int kNarrow = 4;        ///< part of the range below which the used part is stretched
constexpr int kLeastSpread = 64;  ///< values of a stretched range
constexpr double kSmoother = 2;   ///< times that exchanged bytes must be smoother

/// The least value that at least `share` of all do not exceed.
int quantile(const DeepHistogram& histogram, uint64_t total, double share) {
  const auto wanted = static_cast<uint64_t>(share * static_cast<double>(total));
  uint64_t sum = 0;
  for (size_t value = 0; value < histogram.size(); ++value) {
    sum += histogram[value];
    if (sum > wanted) return static_cast<int>(value);
  }
  return static_cast<int>(kValues) - 1;
}

uint16_t exchanged(uint16_t value) {
  return static_cast<uint16_t>(value << 8 | value >> 8);
}

/// How much neighbours differ, right and below, for the spread of all: large for noise, small for images.
template <typename Value>
double roughness(const DeepImage& image, Value value) {
  const auto width = static_cast<size_t>(image.width);
  const auto at = [&](size_t i) { return int{value(image.pixels[i])}; };
  double sum = 0;
  for (const uint16_t pixel : image.pixels) sum += value(pixel);
  const double mean = sum / static_cast<double>(image.pixels.size());
  double spread = 0;
  double steps = 0;
  for (size_t i = 0; i < image.pixels.size(); ++i) {
    spread += std::abs(at(i) - mean);
    if (i % width != 0) steps += std::abs(at(i) - at(i - 1));
    if (i >= width) steps += std::abs(at(i) - at(i - width));
  }
  return spread > 0 ? steps / spread : 0;
}

/// Headers of the images in a sample, and the values of those with more than 8 bits.
class Sampler {
 public:
  /// Takes an image into the sample. Returns whether it counts: its header can be read, and it is not too
  /// large.
  bool look(const std::filesystem::path& path) {
    const auto content = read_file(path);
    if (!content) return false;
    const std::span bytes(reinterpret_cast<const uint8_t*>(content->data()), content->size());
    const auto header = read_image_header(bytes);
    if (!header || header->width > kMaxImageSide || header->height > kMaxImageSide) return false;
    auto size = std::pair(static_cast<int>(header->width), static_cast<int>(header->height));
    if (lies_on_its_side(header->orientation)) std::swap(size.first, size.second);
    sizes_.push_back(size);
    orientations_.emplace(size, header->orientation);
    if (header->bits > 8) count(bytes, header->format);
    return true;
  }
  [[nodiscard]] ImageSample result() const {
    ImageSample sample;
    if (sizes_.empty()) return sample;
    const auto commonest = std::max_element(sizes_.begin(), sizes_.end(), [&](const auto& a, const auto& b) {
      return std::count(sizes_.begin(), sizes_.end(), a) < std::count(sizes_.begin(), sizes_.end(), b);
    });
    sample.size = ImageSize{commonest->first, commonest->second};
    for (const auto& [size, orientation] : orientations_)
      if (size == *commonest) sample.orientations.insert(orientation);
    const bool exchange = 2 * exchanged_ > deep_;
    sample.levels = used_levels(exchange ? exchanged_values_ : values_);
    if (exchange) {
      if (!sample.levels) sample.levels = GrayLevels{};
      sample.levels->exchange_bytes = true;
    }
    return sample;
  }

 private:
  void count(std::span<const uint8_t> bytes, ImageFormat format) {
    const auto image = decode_deep_image(bytes);
    if (!image) return;
    ++deep_;
    // The bytes of PNG lie as its specification says.
    exchanged_ += format == ImageFormat::kPnm && has_exchanged_bytes(*image) ? 1 : 0;
    for (const uint16_t value : image->pixels) {
      ++values_[value];
      ++exchanged_values_[exchanged(value)];
    }
  }

  std::vector<std::pair<int, int>> sizes_;
  std::set<std::pair<std::pair<int, int>, int>> orientations_;
  DeepHistogram values_ = DeepHistogram(kValues);
  DeepHistogram exchanged_values_ = DeepHistogram(kValues);
  size_t deep_ = 0;       ///< images with more than 8 bits
  size_t exchanged_ = 0;  ///< of those
};

}  // namespace

std::optional<GrayLevels> used_levels(const DeepHistogram& histogram) {
  const auto total = std::accumulate(histogram.begin(), histogram.end(), uint64_t{0});
  if (total == 0) return std::nullopt;
  const int low = quantile(histogram, total, kFaults);
  const int high = quantile(histogram, total, 1 - kFaults);
  const int bits = std::max(kLeastBits, static_cast<int>(std::bit_width(static_cast<unsigned>(high))));
  const int white = (1 << bits) - 1;
  if (low > 0 && (high - low) * kNarrow < white) {
    const int margin = std::max(high - low, kLeastSpread) / 2;
    return GrayLevels{std::max(0, low - margin), std::min(static_cast<int>(kValues) - 1, high + margin)};
  }
  if (bits == kAllBits) return std::nullopt;
  return GrayLevels{0, white};
}

bool has_exchanged_bytes(const DeepImage& image) {
  return roughness(image, exchanged) * kSmoother < roughness(
                                                       image, [](uint16_t value) { return value; });
}

ImageSample sample_images(std::span<const std::filesystem::path> paths) {
  Sampler sampler;
  size_t readable = 0;
  const size_t count = std::min(paths.size(), kImages);
  for (size_t i = 0; i < count; ++i) readable += sampler.look(paths[i * paths.size() / count]) ? 1 : 0;
  for (size_t i = 0; i < paths.size() && readable == 0; ++i) readable += sampler.look(paths[i]) ? 1 : 0;
  return sampler.result();
}

}  // namespace cairn
