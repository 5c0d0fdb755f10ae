// SPDX-License-Identifier: Apache-2.0
#include "client/session/image_encoder.h"

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

namespace cairn {

wire::ImageMessage encode_image(const GrayView& image, wire::ImageEncoding encoding) {
  wire::ImageMessage message;
  message.encoding = encoding;
  message.width = static_cast<uint32_t>(image.width);
  message.height = static_cast<uint32_t>(image.height);
  if (encoding == wire::ImageEncoding::kJpeg) {
    // OpenCV has no read-only matrix over foreign memory; imencode only reads.
    const cv::Mat pixels(image.height, image.width, CV_8UC1, const_cast<uint8_t*>(image.data),
                         static_cast<size_t>(image.stride));
    cv::imencode(".jpg", pixels, message.bytes, {cv::IMWRITE_JPEG_QUALITY, kJpegQuality});
    return message;
  }
  message.bytes.reserve(static_cast<size_t>(image.width) * static_cast<size_t>(image.height));
  for (int y = 0; y < image.height; ++y) {
    message.bytes.insert(message.bytes.end(), image.row(y), image.row(y) + image.width);
  }
  return message;
}

}  // namespace cairn
