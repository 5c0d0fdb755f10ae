// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/described_scale.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace cairn {
namespace {

constexpr float kHalfOctave = 1.41421356F;

int reduced_size(int size) {
  return static_cast<int>(static_cast<float>(size) / kHalfOctave);
}

constexpr float kRounding = 0.5F;  ///< to the nearest grey level

/// Between which pixels of a row or column one of the reduced image lies.
struct Between {
  int pixel = 0;   ///< and the next
  float part = 0;  ///< of the way to the next
};

Between locate(int reduced, int size) {
  const float at = std::clamp((static_cast<float>(reduced) + 0.5F) * kHalfOctave - 0.5F, 0.0F,
                              static_cast<float>(size) - 1.001F);
  const int pixel = static_cast<int>(at);
  return {pixel, at - static_cast<float>(pixel)};
}

/// The part from (left, top) on of the image reduced by the square root of two, bilinearly. The
/// same as sample_bilinear(), which is slow when asked for one pixel after the other.
void reduce(const GrayView& image, int left, int top, int width, int height, GrayImage* out) {
  out->resize(width, height);
  std::vector<Between> columns;
  columns.reserve(static_cast<size_t>(width));
  for (int x = 0; x < width; ++x) columns.push_back(locate(left + x, image.width));
  for (int y = 0; y < height; ++y) {
    const Between row = locate(top + y, image.height);
    const uint8_t* above = image.row(row.pixel);
    const uint8_t* below = above + image.stride;
    uint8_t* to = out->row(y);
    for (size_t x = 0; x < columns.size(); ++x) {
      const Between& column = columns[x];
      const auto along = [&column](const uint8_t* from) {
        const uint8_t* first = from + column.pixel;
        return static_cast<float>(first[0]) + column.part * static_cast<float>(first[1] - first[0]);
      };
      const float rounded = along(above) + row.part * (along(below) - along(above)) + kRounding;
      to[x] = static_cast<uint8_t>(rounded);
    }
  }
}

}  // namespace

DescribedScale::DescribedScale(const GrayView& level, bool is_half, size_t corners)
    : level_(level),
      is_half_(is_half),
      width_(is_half ? reduced_size(level.width) : level.width),
      height_(is_half ? reduced_size(level.height) : level.height) {
  constexpr size_t kAround = 2 * (kDescriptorRadius + kSmoothingRadius) + 1;
  is_whole_ = corners * kAround * kAround > static_cast<size_t>(width_) * static_cast<size_t>(height_);
  if (is_whole_) smooth(0, 0, width_, height_);
}

Eigen::Vector2i DescribedScale::nearest_pixel(const Eigen::Vector2f& pixel) const {
  const auto place = [&](float v) {
    return static_cast<int>(std::lround(is_half_ ? (v + 0.5F) / kHalfOctave - 0.5F : v));
  };
  return {place(pixel.x()), place(pixel.y())};
}

void DescribedScale::smooth(int left, int top, int width, int height) {
  left_ = left;
  top_ = top;
  if (is_half_) {
    reduce(level_, left, top, width, height, &reduced_);
    smooth_for_descriptors(reduced_, &smoothed_);
  } else {
    smooth_for_descriptors({level_.row(top) + left, width, height, level_.stride}, &smoothed_);
  }
}

bool DescribedScale::describe(const Eigen::Vector2f& pixel, Descriptor* out) {
  const Eigen::Vector2i corner = nearest_pixel(pixel);
  const auto is_inside = [](int at, int size) {
    return at >= kDescriptorRadius && at < size - kDescriptorRadius;
  };
  if (!is_inside(corner.x(), width_) || !is_inside(corner.y(), height_)) return false;
  if (!is_whole_) {
    constexpr int kReach = kDescriptorRadius + kSmoothingRadius;
    const int left = std::max(0, corner.x() - kReach);
    const int top = std::max(0, corner.y() - kReach);
    smooth(left, top, std::min(width_, corner.x() + kReach + 1) - left,
           std::min(height_, corner.y() + kReach + 1) - top);
  }
  return cairn::describe(
      smoothed_, {static_cast<int16_t>(corner.x() - left_), static_cast<int16_t>(corner.y() - top_)}, out);
}

}  // namespace cairn
