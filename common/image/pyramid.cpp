// SPDX-License-Identifier: Apache-2.0
#include "common/image/pyramid.h"

#include "common/image/kernels.h"

namespace cairn {
namespace {

/// out[x] = mean of the 2x2 block at 2x for x in [begin, width).
void halve_row_scalar(const uint8_t* top, const uint8_t* bottom, uint8_t* out, int begin, int width) {
  for (int x = begin; x < width; ++x) {
    const int sum = top[2 * x] + top[2 * x + 1] + bottom[2 * x] + bottom[2 * x + 1];
    out[x] = static_cast<uint8_t>((sum + 2) >> 2);
  }
}

void halve_row_narrow(const uint8_t* top, const uint8_t* bottom, uint8_t* out, int width) {
  const auto eight = [&](int x) {
    return (sums_of_pairs(load_lanes<U8x16>(top + 2 * x)) + sums_of_pairs(load_lanes<U8x16>(bottom + 2 * x)) +
            2) >>
           2;
  };
  int x = 0;
  for (; x + 16 <= width; x += 16) store_as_bytes(out + x, eight(x), eight(x + 8));
  halve_row_scalar(top, bottom, out, x, width);
}

CAIRN_WIDE void halve_row_wide(const uint8_t* top, const uint8_t* bottom, uint8_t* out, int width) {
  const auto sixteen = [&](int x) CAIRN_WIDE {
    return (sums_of_pairs(load_wide<U8x32>(top + 2 * x)) + sums_of_pairs(load_wide<U8x32>(bottom + 2 * x)) +
            2) >>
           2;
  };
  int x = 0;
  for (; x + 32 <= width; x += 32) store_as_bytes(out + x, sixteen(x), sixteen(x + 16));
  halve_row_scalar(top, bottom, out, x, width);
}

void halve_row(const uint8_t* top, const uint8_t* bottom, uint8_t* out, int width, Simd simd) {
  switch (simd) {
    case Simd::kWide:
      return halve_row_wide(top, bottom, out, width);
    case Simd::kNarrow:
      return halve_row_narrow(top, bottom, out, width);
    case Simd::kScalar:
      return halve_row_scalar(top, bottom, out, 0, width);
  }
}

}  // namespace

void kernels::halve(const GrayView& src, GrayImage* dst, Simd simd) {
  dst->resize(src.width / 2, src.height / 2);
  for (int y = 0; y < dst->height(); ++y)
    halve_row(src.row(2 * y), src.row(2 * y + 1), dst->row(y), dst->width(), simd);
}

void halve(const GrayView& src, GrayImage* dst) {
  kernels::halve(src, dst, best_simd());
}

void Pyramid::build(const GrayView& image) {
  const Simd simd = best_simd();
  GrayImage& base = levels_[0];
  GrayImage& half = levels_[1];
  base.resize(image.width, image.height);
  half.resize(image.width / 2, image.height / 2);
  // The first halving rides on the copy: the frame goes through the cache once.
  const auto row_bytes = static_cast<size_t>(image.width);
  for (int y = 0; y < image.height; ++y) {
    std::memcpy(base.row(y), image.row(y), row_bytes);
    if (y % 2 == 1) halve_row(base.row(y - 1), base.row(y), half.row(y / 2), half.width(), simd);
  }
  for (size_t l = 2; l < levels_.size(); ++l) kernels::halve(levels_[l - 1], &levels_[l], simd);
}

}  // namespace cairn
