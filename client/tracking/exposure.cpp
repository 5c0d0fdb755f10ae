// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/exposure.h"

#include <algorithm>
#include <cmath>

#include "common/image/patch.h"
#include "common/image/pyramid.h"

namespace cairn {
namespace {

constexpr double kStep = 1.0 / 240;    // [s] an eighth of a frame at 30 Hz
constexpr double kLongest = 1.0 / 15;  // [s]
constexpr double kKept = 0.95;         // of what frames have told, per frame
constexpr float kLeastWay = 0.5F;      // [search-level px] that a step must add for a point to tell anything
constexpr size_t kMostAsked = 200;     // of the points, and of these
constexpr int kMostTelling = 24;       // who tell something: half a microsecond for each template
// Curvature that a grey value of noise in each of their pixels makes.
constexpr double kNoise = double{kMostTelling} * kTemplatePixels;
constexpr int kBorder = kTemplateSize / 2;

}  // namespace

void Exposure::next_frame(const TinyMotion& motion, double seconds, FrameImages* now) {
  const GrayImage& image = now->pyramid.level(0);
  step_ = {};
  if (!(seconds > 0)) return;
  const auto smear_of = [&](double exposed) {
    return Smear(motion, static_cast<float>(exposed / seconds), image.width(), image.height());
  };
  step_ = smear_of(kStep);
  if (seconds_ > 0) now->smear = smear_of(std::min(seconds_, seconds));
}

std::optional<Exposure::Misfits> Exposure::misfits(const FrameImages& now, const VisiblePoint& point,
                                                   const SourcePatch& source, double middle) const {
  const int level = point.level;
  const GrayImage& image = now.pyramid.level(level);
  const Eigen::Vector2f step = step_.at(point.pixel);
  if (!point.found || step.norm() < kLeastWay * static_cast<float>(1 << level)) return std::nullopt;
  const Eigen::Vector2f at(to_level(point.pixel.x(), level), to_level(point.pixel.y(), level));
  const auto x = static_cast<int>(std::lround(at.x()));
  const auto y = static_cast<int>(std::lround(at.y()));
  if (x < kBorder || y < kBorder || x > image.width() - kBorder || y > image.height() - kBorder)
    return std::nullopt;
  const Eigen::Vector2f aside = Eigen::Vector2i(x, y).cast<float>() - at;
  Misfits result{};
  for (size_t i = 0; i < result.size(); ++i) {
    const auto steps = static_cast<float>(middle / kStep - 1 + static_cast<double>(i));
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
  const double middle = std::max(seconds_, kStep);  // no exposure is shorter than 0
  Misfits sums{};
  int count = 0;
  const size_t stride = points.size() / kMostAsked + 1;
  for (size_t i = 0; i < points.size() && count < kMostTelling; i += stride) {
    const VisiblePoint& p = points[i];
    const PointBlock& block = *map.point_blocks[static_cast<size_t>(p.slot.block)];
    const auto told = misfits(now, p, block.source(p.slot.slot).pixels, middle);
    if (!told) continue;
    ++count;
    for (size_t k = 0; k < sums.size(); ++k) sums[k] += (*told)[k];
  }
  if (count == 0) return;
  const double curvature = std::max(0.0, sums[0] + sums[2] - 2 * sums[1]);
  const double slope = (sums[2] - sums[0]) / 2 + curvature * (seconds_ - middle) / kStep;
  information_ = kKept * information_ + curvature;
  const double steps = std::clamp(slope / (information_ + kNoise), -1.0, 1.0);
  seconds_ = std::clamp(seconds_ - steps * kStep, 0.0, kLongest);
}

}  // namespace cairn
