// SPDX-License-Identifier: Apache-2.0
#include "common/io/image_file.h"

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "common/io/image_header.h"
#include "common/io/text.h"

namespace cairn {

Result<GrayImage> decode_gray_image(std::span<const uint8_t> bytes) {
  if (bytes.empty()) return fail(ErrorCode::kDamaged, "the file is empty");
  const auto header = read_image_header(bytes);
  if (!header) return tl::unexpected(header.error());
  const auto size = std::to_string(header->width) + "x" + std::to_string(header->height);
  if (header->width < 1 || header->height < 1 || header->width > kMaxImageSide ||
      header->height > kMaxImageSide) {
    return fail(ErrorCode::kDamaged, "an image of " + size + " pixels; sides from 1 to " +
                                         std::to_string(kMaxImageSide) + " are read");
  }
  if (!header->complete) return fail(ErrorCode::kDamaged, "the image (" + size + ") is cut short");
  cv::Mat pixels;
  try {
    const cv::Mat encoded(1, static_cast<int>(bytes.size()), CV_8U, const_cast<uint8_t*>(bytes.data()));
    pixels = cv::imdecode(encoded, cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception& error) {
    return fail(ErrorCode::kDamaged, "the image cannot be decoded: " + error.err);
  }
  if (pixels.empty())
    return fail(ErrorCode::kDamaged, "the image (" + size + ") cannot be decoded: cut short or damaged");
  return GrayImage(GrayView{pixels.data, pixels.cols, pixels.rows, static_cast<int>(pixels.step)});
}

Result<GrayImage> read_gray_image(const std::filesystem::path& path) {
  const auto content = read_file(path);
  if (!content) return tl::unexpected(content.error());
  auto image = decode_gray_image({reinterpret_cast<const uint8_t*>(content->data()), content->size()});
  if (!image) image.error().message = path.string() + ": " + image.error().message;
  return image;
}

}  // namespace cairn
