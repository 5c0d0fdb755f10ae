// SPDX-License-Identifier: Apache-2.0
#include "server/admin/proposal_image.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <opencv2/imgcodecs.hpp>

#include "common/io/image_file.h"

namespace cairn {
namespace {

constexpr int kHalf = 3;  ///< [px] of a mark's side
using Colour = std::array<uint8_t, 3>;
constexpr Colour kFound{60, 220, 60};    // blue, green, red
constexpr Colour kMissing{60, 60, 255};  // likewise

void paint(int x, int y, const Colour& colour, cv::Mat* image) {
  if (x < 0 || y < 0 || x >= image->cols || y >= image->rows) return;
  std::copy(colour.begin(), colour.end(), image->ptr<uint8_t>(y) + 3 * static_cast<ptrdiff_t>(x));
}

void mark(const MarkedPoint& point, cv::Mat* image) {
  for (int dy = -kHalf; dy <= kHalf; ++dy) {
    for (int dx = -kHalf; dx <= kHalf; ++dx) {
      const bool is_edge = std::max(std::abs(dx), std::abs(dy)) == kHalf;
      const bool is_cross = std::abs(dx) == std::abs(dy);
      if (point.found ? is_edge : is_cross)
        paint(point.x + dx, point.y + dy, point.found ? kFound : kMissing, image);
    }
  }
}

}  // namespace

Result<std::vector<uint8_t>> with_points(std::span<const uint8_t> encoded,
                                         std::span<const MarkedPoint> points) {
  const Result<GrayImage> grey = decode_gray_image(encoded);
  if (!grey) return tl::unexpected(grey.error());
  cv::Mat image(grey->height(), grey->width(), CV_8UC3);
  for (int y = 0; y < image.rows; ++y) {
    const uint8_t* from = grey->view().row(y);
    uint8_t* to = image.ptr<uint8_t>(y);
    for (int x = 0; x < image.cols; ++x) std::fill_n(to + 3 * static_cast<ptrdiff_t>(x), 3, from[x]);
  }
  for (const MarkedPoint& point : points) mark(point, &image);
  std::vector<uint8_t> png;
  if (!cv::imencode(".png", image, png)) return fail(ErrorCode::kInternal, "the image cannot be encoded");
  return png;
}

}  // namespace cairn
