// SPDX-License-Identifier: Apache-2.0
// For builds without OpenCV's freetype module or fontconfig.
#include "client/app/unicode_fonts.h"

namespace cairn {

struct UnicodeFonts::Impl {};

UnicodeFonts::UnicodeFonts() = default;
UnicodeFonts::~UnicodeFonts() = default;

std::optional<cv::Size> UnicodeFonts::size(const std::string& /*text*/, int /*height*/) {
  return std::nullopt;
}

bool UnicodeFonts::draw(const std::string& /*text*/, cv::Point /*baseline*/, int /*height*/,
                        const cv::Scalar& /*ink*/, cv::Mat* /*image*/) {
  return false;
}

}  // namespace cairn
