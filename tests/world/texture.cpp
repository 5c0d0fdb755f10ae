// SPDX-License-Identifier: Apache-2.0
#include "tests/world/texture.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <stdexcept>

namespace cairn {
namespace {

/// Pixels of [low, high] that lie in 0..size-1, as a half-open range.
struct Range {
  int begin;
  int end;
};
Range covered(float low, float high, int size) {
  const float limit = static_cast<float>(size);
  return {static_cast<int>(std::floor(std::clamp(low, 0.0F, limit))),
          static_cast<int>(std::ceil(std::clamp(high + 1.0F, 0.0F, limit)))};
}

uint32_t to_byte(float reflectance) {
  return static_cast<uint32_t>(std::clamp(reflectance, 0.0F, 1.0F) * 255.0F + 0.5F);
}

Texture::Level pack(const Bitmap& picture) {
  const int w = picture.width();
  const int h = picture.height();
  Texture::Level level;
  level.width_mask = w - 1;
  level.height_mask = h - 1;
  level.stride = w + 1;
  level.pairs.reserve(static_cast<size_t>(level.stride) * static_cast<size_t>(h));
  for (int y = 0; y < h; ++y) {
    const int below = (y + 1) & level.height_mask;
    for (int x = 0; x < level.stride; ++x) {
      const int column = x & level.width_mask;
      level.pairs.push_back(
          static_cast<uint16_t>(to_byte(picture.at(column, y)) | to_byte(picture.at(column, below)) << 8));
    }
  }
  return level;
}

Bitmap half_size(const Bitmap& picture) {
  const int step_x = picture.width() > 1 ? 2 : 1;
  const int step_y = picture.height() > 1 ? 2 : 1;
  Bitmap half(picture.width() / step_x, picture.height() / step_y);
  for (int y = 0; y < half.height(); ++y) {
    for (int x = 0; x < half.width(); ++x) {
      const int x0 = x * step_x;
      const int y0 = y * step_y;
      const int x1 = x0 + step_x - 1;
      const int y1 = y0 + step_y - 1;
      half.at(x, y) =
          0.25F * (picture.at(x0, y0) + picture.at(x1, y0) + picture.at(x0, y1) + picture.at(x1, y1));
    }
  }
  return half;
}

}  // namespace

Bitmap::Bitmap(int width, int height, float value)
    : width_(width),
      height_(height),
      pixels_(static_cast<size_t>(width) * static_cast<size_t>(height), value) {}

void Bitmap::blend(int x, int y, float coverage, float value) {
  if (coverage <= 0) return;
  float& pixel = at(x, y);
  pixel += std::min(coverage, 1.0F) * (value - pixel);
}

void Bitmap::fill_rectangle(float x0, float y0, float x1, float y1, float value) {
  const Range columns = covered(x0, x1, width_);
  const Range rows = covered(y0, y1, height_);
  const auto overlap = [](float low, float high, int pixel) {
    const float centre = static_cast<float>(pixel);
    return std::clamp(std::min(high, centre + 0.5F) - std::max(low, centre - 0.5F), 0.0F, 1.0F);
  };
  for (int y = rows.begin; y < rows.end; ++y) {
    for (int x = columns.begin; x < columns.end; ++x) {
      blend(x, y, overlap(x0, x1, x) * overlap(y0, y1, y), value);
    }
  }
}

void Bitmap::fill_disc(float x, float y, float radius, float value) {
  stroke(x, y, x, y, radius, value);
}

void Bitmap::stroke(float x0, float y0, float x1, float y1, float radius, float value) {
  const float reach = radius + 1.0F;
  const Range columns = covered(std::min(x0, x1) - reach, std::max(x0, x1) + reach, width_);
  const Range rows = covered(std::min(y0, y1) - reach, std::max(y0, y1) + reach, height_);
  const float dx = x1 - x0;
  const float dy = y1 - y0;
  const float squared_length = std::max(dx * dx + dy * dy, 1e-12F);
  for (int y = rows.begin; y < rows.end; ++y) {
    for (int x = columns.begin; x < columns.end; ++x) {
      const float px = static_cast<float>(x) - x0;
      const float py = static_cast<float>(y) - y0;
      const float along = std::clamp((px * dx + py * dy) / squared_length, 0.0F, 1.0F);
      const float distance = std::hypot(px - along * dx, py - along * dy);
      blend(x, y, radius - distance + 0.5F, value);
    }
  }
}

void Bitmap::shade_rectangle(float x, float y, float half_width, float half_height, float angle,
                             float softness, float darkness) {
  const float reach = std::hypot(half_width, half_height) + softness;
  const Range columns = covered(x - reach, x + reach, width_);
  const Range rows = covered(y - reach, y + reach, height_);
  const float c = std::cos(angle);
  const float s = std::sin(angle);
  const auto inside = [softness](float distance_beyond_edge) {
    const float t = std::clamp(0.5F - 0.5F * distance_beyond_edge / softness, 0.0F, 1.0F);
    return t * t * (3.0F - 2.0F * t);
  };
  for (int row = rows.begin; row < rows.end; ++row) {
    for (int column = columns.begin; column < columns.end; ++column) {
      const float px = static_cast<float>(column) - x;
      const float py = static_cast<float>(row) - y;
      const float along = std::abs(c * px + s * py) - half_width;
      const float across = std::abs(c * py - s * px) - half_height;
      at(column, row) *= 1.0F - darkness * inside(along) * inside(across);
    }
  }
}

void Bitmap::paste(const Bitmap& picture, int x, int y) {
  for (int row = std::max(0, -y); row < std::min(picture.height(), height_ - y); ++row) {
    for (int column = std::max(0, -x); column < std::min(picture.width(), width_ - x); ++column) {
      at(x + column, y + row) = picture.at(column, row);
    }
  }
}

void Bitmap::clamp() {
  for (float& pixel : pixels_) pixel = std::clamp(pixel, 0.0F, 1.0F);
}

Texture::Texture(const Bitmap& picture) {
  if (!std::has_single_bit(static_cast<unsigned>(picture.width())) ||
      !std::has_single_bit(static_cast<unsigned>(picture.height()))) {
    throw std::invalid_argument("texture: width and height must be powers of two");
  }
  levels_.push_back(pack(picture));
  Bitmap level = picture;
  while (level.width() > 1 || level.height() > 1) {
    level = half_size(level);
    levels_.push_back(pack(level));
  }
}

}  // namespace cairn
