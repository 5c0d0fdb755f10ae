// SPDX-License-Identifier: Apache-2.0
#include "client/app/images/image_codec.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "common/io/image_header.h"

namespace cairn {
namespace {

constexpr int kQuality = 75;  // of JPEG: a camera's image of 640x480 has some 40 kB
constexpr int kLeastQuality = 35;
constexpr int kQualityStep = 20;
constexpr double kSmaller = 0.7;  // a side, where that does not do

cv::Mat scaled(const cv::Mat& pixels, double scale) {
  const auto side = [scale](int length) {
    return std::max(1, static_cast<int>(std::lround(scale * length)));
  };
  cv::Mat small;
  cv::resize(pixels, small, {side(pixels.cols), side(pixels.rows)}, 0, 0, cv::INTER_AREA);
  return small;
}

}  // namespace

wire::ImageMessage encode_camera_image(const cv::Mat& pixels) {
  const double fit = static_cast<double>(wire::kMaxCameraImageSide) / std::max(pixels.cols, pixels.rows);
  cv::Mat small = fit < 1 ? scaled(pixels, fit) : pixels;
  wire::ImageMessage message;
  message.encoding = wire::ImageEncoding::kJpeg;
  for (int quality = kQuality;;) {
    cv::imencode(".jpg", small, message.bytes, {cv::IMWRITE_JPEG_QUALITY, quality});
    if (message.bytes.size() <= wire::kMaxCameraImageBytes) break;
    if (quality > kLeastQuality) {
      quality -= kQualityStep;
    } else {
      small = scaled(small, kSmaller);
    }
  }
  message.width = static_cast<uint32_t>(small.cols);
  message.height = static_cast<uint32_t>(small.rows);
  return message;
}

Result<cv::Mat> decode_camera_image(const wire::ImageMessage& image) {
  const auto header = read_image_header(image.bytes);
  if (!header) return tl::unexpected(header.error());
  // Before anything is made of that size.
  if (header->width != image.width || header->height != image.height || !header->complete)
    return fail(ErrorCode::kDamaged, "an image that is cut short or of another size than is said");
  cv::Mat pixels;
  try {
    pixels = cv::imdecode(image.bytes, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception& error) {
    return fail(ErrorCode::kDamaged, "an image that cannot be decoded: " + error.err);
  }
  if (pixels.empty()) return fail(ErrorCode::kDamaged, "an image that cannot be decoded");
  return pixels;
}

TrackingState tracking_state_of(FrameState state) {
  switch (state) {
    case FrameState::kTracking:
      return TrackingState::kTracking;
    case FrameState::kPoor:
      return TrackingState::kPoor;
    case FrameState::kRotation:
      return TrackingState::kRotation;
    case FrameState::kLost:
    case FrameState::kDropped:
      return TrackingState::kLost;
    case FrameState::kStarting:
      break;
  }
  return TrackingState::kStarting;
}

FrameState frame_state_of(TrackingState state) {
  switch (state) {
    case TrackingState::kTracking:
      return FrameState::kTracking;
    case TrackingState::kPoor:
      return FrameState::kPoor;
    case TrackingState::kRotation:
      return FrameState::kRotation;
    case TrackingState::kLost:
      return FrameState::kLost;
    case TrackingState::kStarting:
      break;
  }
  return FrameState::kStarting;
}

}  // namespace cairn
