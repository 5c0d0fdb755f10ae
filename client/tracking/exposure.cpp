// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/exposure.h"

#include <algorithm>
#include <cmath>

#include "common/image/patch.h"
#include "common/image/pyramid.h"

namespace cairn {
namespace {

constexpr int kBorder = kTemplateSize / 2;

}  // namespace

void Exposure::next_frame(const TinyMotion& motion, double seconds, FrameImages* now) {
  const GrayImage& image = now->pyramid.level(0);
  step_ = {};
  if (!(seconds > 0)) return;
  const auto smear_of = [&](double exposed) {
    return Smear(motion, static_cast<float>(exposed / seconds), image.width(), image.height());
  };
  step_ = smear_of(options_.step);
  if (seconds_ > 0) now->smear = smear_of(std::min(seconds_, seconds));
}

std::optional<Exposure::Misfits> Exposure::misfits(const FrameImages& now, const VisiblePoint& point,
                                                   const SourcePatch& source, double middle) const {
  const int level = point.level;
  const GrayImage& image = now.pyramid.level(level);
  const Eigen::Vector2f step = step_.at(point.pixel);
  if (!point.found || step.norm() < options_.least_smear * static_cast<float>(1 << level))
    return std::nullopt;
  const Eigen::Vector2f at(to_level(point.pixel.x(), level), to_level(point.pixel.y(), level));
  const auto x = static_cast<int>(std::lround(at.x()));
  const auto y = static_cast<int>(std::lround(at.y()));
  if (x < kBorder || y < kBorder || x > image.width() - kBorder || y > image.height() - kBorder)
    return std::nullopt;
  const Eigen::Vector2f aside = Eigen::Vector2i(x, y).cast<float>() - at;
  Misfits result{};
  for (size_t i = 0; i < result.size(); ++i) {
    const auto steps = static_cast<float>(middle / options_.step - 1 + static_cast<double>(i));
    PatchTemplate patch;
    if (!make_smeared_template(source, point.level0_from_source, level, steps * step, aside, &patch))
      return std::nullopt;
    result[i] = std::min(zmssd_at(patch, image, x, y), kMaxZmssd);
  }
  return result;
}

/// A step of Newton's method on the misfits of a frame, damped by what the frames before have told.
void Exposure::learn(const FrameImages& now, std::span<const VisiblePoint> points, const MapSnapshot& map) {
  if (step_.is_none()) return;
  const double middle = std::max(seconds_, options_.step);  // no exposure is shorter than 0
  Misfits sums{};
  int count = 0;
  const size_t stride = points.size() / options_.most_asked + 1;
  for (size_t i = 0; i < points.size() && count < options_.most_telling; i += stride) {
    const VisiblePoint& p = points[i];
    const PointBlock& block = *map.point_blocks[static_cast<size_t>(p.slot.block)];
    const auto told = misfits(now, p, block.source(p.slot.slot).pixels, middle);
    if (!told) continue;
    ++count;
    for (size_t k = 0; k < sums.size(); ++k) sums[k] += (*told)[k];
  }
  if (count == 0) return;
  const double curvature = std::max(0.0, sums[0] + sums[2] - 2 * sums[1]);
  const double slope = (sums[2] - sums[0]) / 2 + curvature * (seconds_ - middle) / options_.step;
  // Curvature that a grey value of noise in each pixel of those who tell makes.
  const double noise = static_cast<double>(options_.most_telling) * kTemplatePixels;
  information_ = options_.kept * information_ + curvature;
  const double steps = std::clamp(slope / (information_ + noise), -1.0, 1.0);
  seconds_ = std::clamp(seconds_ - steps * options_.step, 0.0, options_.longest);
}

}  // namespace cairn
