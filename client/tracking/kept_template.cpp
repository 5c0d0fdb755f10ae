// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/kept_template.h"

#include <algorithm>
#include <cmath>

#include "common/image/pyramid.h"
#include "common/image/smear.h"

namespace cairn {
namespace {

constexpr int kBorder = kTemplateSize / 2;

bool is_smeared(const Eigen::Vector2f& smear, int level, const KeptTemplateOptions& options) {
  return smear.norm() >= options.least_smear * static_cast<float>(1 << level);
}

std::optional<Eigen::Vector2f> best_pixel(const PatchTemplate& patch, const GrayView& image,
                                          const Eigen::Vector2f& center, float radius) {
  const auto reach = static_cast<int>(radius);
  const auto x = static_cast<int>(std::lround(center.x()));
  const auto y = static_cast<int>(std::lround(center.y()));
  int least = kMaxZmssd;
  std::optional<Eigen::Vector2f> best;
  for (int v = std::max(y - reach, kBorder); v <= std::min(y + reach, image.height - kBorder); ++v) {
    for (int u = std::max(x - reach, kBorder); u <= std::min(x + reach, image.width - kBorder); ++u) {
      const int zmssd = zmssd_at(patch, image, u, v);
      if (zmssd >= least) continue;
      least = zmssd;
      best = Eigen::Vector2i(u, v).cast<float>();
    }
  }
  return best;
}

}  // namespace

const PatchTemplate* KeptTemplate::of(const SourcePatch& source, const Warp& level0_from_source, int level,
                                      const Eigen::Vector2f& smear, const KeptTemplateOptions& options) {
  const auto scale = static_cast<float>(1 << level);
  const Eigen::Vector2f wanted = is_smeared(smear, level, options) ? smear : Eigen::Vector2f::Zero();
  const bool is_sharp = wanted.isZero();
  if (valid_ && patch_.level == level && (smear_ - wanted).norm() <= options.smear_change * wanted.norm() &&
      (warp_ - level0_from_source).colwise().norm().maxCoeff() <= options.template_change * scale)
    return &patch_;
  valid_ = is_sharp ? make_template(source, level0_from_source, level, &patch_)
                    : make_smeared_template(source, level0_from_source, level, wanted,
                                            Eigen::Vector2f::Zero(), &patch_);
  warp_ = level0_from_source;
  smear_ = wanted;
  return valid_ ? &patch_ : nullptr;
}

std::optional<Eigen::Vector2f> look_around(const PatchTemplate& patch, const FrameImages& frame,
                                           const Eigen::Vector2f& center, float radius, int iterations,
                                           const KeptTemplateOptions& options) {
  const int level = patch.level;
  const GrayImage& image = frame.pyramid.level(level);
  const Eigen::Vector2f pixel(from_level(center.x(), level), from_level(center.y(), level));
  std::optional<Eigen::Vector2f> best;
  if (level >= options.coarse_level && is_smeared(frame.smear.at(pixel), level, options)) {
    best = best_pixel(patch, image, center, radius);
  } else if (const auto match = find_patch(patch, image, frame.corners(level), center, radius)) {
    best = Eigen::Vector2f(match->corner.x, match->corner.y);
  }
  return best ? refine_patch(patch, image, *best, iterations) : std::nullopt;
}

}  // namespace cairn
