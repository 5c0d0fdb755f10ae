// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

namespace cairn {

/// A grey picture being painted: reflectance 0 (black) to 1 (white), row-major, (0, 0) top left. Coordinates
/// are in pixels with centres at integers; shapes are anti-aliased over one pixel and clipped to the picture.
class Bitmap {
 public:
  Bitmap(int width, int height, float value = 0);

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] float& at(int x, int y) { return pixels_[index(x, y)]; }
  [[nodiscard]] float at(int x, int y) const { return pixels_[index(x, y)]; }

  void fill_rectangle(float x0, float y0, float x1, float y1, float value);
  void fill_disc(float x, float y, float radius, float value);
  /// Line with round ends.
  void stroke(float x0, float y0, float x1, float y1, float radius, float value);
  /// Multiplies every pixel within the rectangle, rotated by `angle` [rad] about its centre, by 1 - darkness;
  /// the edge falls off over `softness` px on either side.
  void shade_rectangle(float x, float y, float half_width, float half_height, float angle, float softness,
                       float darkness);
  /// Copies `picture` with its top left corner at (x, y).
  void paste(const Bitmap& picture, int x, int y);
  void clamp();

 private:
  [[nodiscard]] size_t index(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x);
  }
  void blend(int x, int y, float coverage, float value);

  int width_;
  int height_;
  std::vector<float> pixels_;
};

/// A picture made ready for the renderer: a chain of half-sized levels down to 1x1, wrapping at the borders.
/// A texel holds the one below it too, so the four of a bilinear look-up are one load of 32 bits. Immutable,
/// shared between threads.
class Texture {
 public:
  struct Level {
    std::vector<uint16_t> pairs;  ///< grey values of (x, y), low byte, and (x, y+1); rows of `stride`
    int32_t stride = 0;           ///< width + 1: the first texel of a row follows its last
    int32_t width_mask = 0;
    int32_t height_mask = 0;

    /// Grey values of (x, y), (x, y+1), (x+1, y), (x+1, y+1), lowest byte first, at index y * stride + x.
    [[nodiscard]] uint32_t quad(int32_t index) const {
      uint32_t word;
      std::memcpy(&word, &pairs[static_cast<size_t>(index)], sizeof word);
      return word;
    }
  };

  /// Width and height must be powers of two (a programming error otherwise: throws std::invalid_argument).
  explicit Texture(const Bitmap& picture);

  [[nodiscard]] int width() const { return levels_.front().width_mask + 1; }
  [[nodiscard]] int height() const { return levels_.front().height_mask + 1; }
  [[nodiscard]] const std::vector<Level>& levels() const { return levels_; }

 private:
  std::vector<Level> levels_;
};

}  // namespace cairn
