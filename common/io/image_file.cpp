// SPDX-License-Identifier: Apache-2.0
#include "common/io/image_file.h"

#include <algorithm>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "common/io/image_header.h"
#include "common/io/orientation.h"
#include "common/io/text.h"

namespace cairn {

namespace {

struct Decoded {
  cv::Mat pixels;  ///< in the order of the file
  int orientation = kUpright;
};

/// The pixels as OpenCV gives them with these flags.
Result<Decoded> decode(std::span<const uint8_t> bytes, int flags) {
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
    pixels = cv::imdecode(encoded, flags | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception& error) {
    return fail(ErrorCode::kDamaged, "the image cannot be decoded: " + error.err);
  }
  if (pixels.empty())
    return fail(ErrorCode::kDamaged, "the image (" + size + ") cannot be decoded: cut short or damaged");
  if (pixels.cols != header->width || pixels.rows != header->height)
    return fail(ErrorCode::kDamaged, "the image is of another size than its header says (" + size + ")");
  return Decoded{pixels, header->orientation};
}

GrayImage to_gray(const cv::Mat& pixels) {
  return GrayImage(GrayView{pixels.data, pixels.cols, pixels.rows, static_cast<int>(pixels.step)});
}

void exchange_bytes(cv::Mat& pixels) {
  for (auto at = pixels.begin<uint16_t>(); at != pixels.end<uint16_t>(); ++at)
    *at = static_cast<uint16_t>(*at << 8 | *at >> 8);
}

Result<Decoded> decode_gray(std::span<const uint8_t> bytes, const std::optional<GrayLevels>& levels) {
  auto decoded = decode(bytes, cv::IMREAD_GRAYSCALE | (levels ? cv::IMREAD_ANYDEPTH : 0));
  if (!decoded || decoded->pixels.depth() != CV_16U) return decoded;
  if (levels->exchange_bytes) exchange_bytes(decoded->pixels);
  const double scale = 255.0 / std::max(1, levels->white - levels->black);
  cv::Mat gray;
  decoded->pixels.convertTo(gray, CV_8U, scale, -scale * levels->black);
  return Decoded{gray, decoded->orientation};
}

}  // namespace

Result<GrayImage> decode_gray_image(std::span<const uint8_t> bytes, const std::optional<GrayLevels>& levels) {
  const auto decoded = decode_gray(bytes, levels);
  if (!decoded) return tl::unexpected(decoded.error());
  return to_gray(decoded->pixels);
}

Result<DeepImage> decode_deep_image(std::span<const uint8_t> bytes) {
  const auto decoded = decode(bytes, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH);
  if (!decoded) return tl::unexpected(decoded.error());
  cv::Mat deep;
  decoded->pixels.convertTo(deep, CV_16U);
  return DeepImage{deep.cols, deep.rows, {deep.begin<uint16_t>(), deep.end<uint16_t>()}};
}

Result<GrayImage> read_gray_image(const std::filesystem::path& path,
                                  const std::optional<GrayLevels>& levels) {
  const auto content = read_file(path);
  if (!content) return tl::unexpected(content.error());
  const auto decoded =
      decode_gray({reinterpret_cast<const uint8_t*>(content->data()), content->size()}, levels);
  if (!decoded) return fail(decoded.error().code, path.string() + ": " + decoded.error().message);
  return to_gray(upright(decoded->pixels, decoded->orientation));
}

}  // namespace cairn
