// SPDX-License-Identifier: Apache-2.0
#include <opencv2/imgcodecs.hpp>

#include "common/image/limits.h"
#include "common/io/image_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace cairn::fuzz {

void decode(Bytes bytes) {
  const auto image = decode_gray_image(bytes);
  if (image) {
    demand(image->width() > 0 && image->width() <= kMaxImageSide, "an image is no wider than kMaxImageSide");
    demand(image->height() > 0 && image->height() <= kMaxImageSide,
           "an image is no higher than kMaxImageSide");
  }
  const auto deep = decode_deep_image(bytes);
  if (deep) {
    demand(deep->pixels.size() == static_cast<size_t>(deep->width) * static_cast<size_t>(deep->height),
           "an image has all its pixels");
  }
}

std::vector<Input> seeds() {
  std::vector<Input> files;
  for (const int type : {CV_8UC1, CV_8UC3, CV_16UC1}) {
    cv::Mat image(24, 32, type);
    cv::randu(image, 0, 255);
    for (const char* suffix : {".png", ".jpg", ".pgm", ".ppm"}) {
      const bool is_possible = type == CV_16UC1 ? suffix != std::string(".jpg") : true;
      std::vector<uint8_t> bytes;
      if (is_possible && (suffix != std::string(".ppm") || image.channels() == 3) &&
          (suffix != std::string(".pgm") || image.channels() == 1) && cv::imencode(suffix, image, bytes))
        files.push_back(std::move(bytes));
    }
  }
  return files;
}

}  // namespace cairn::fuzz
