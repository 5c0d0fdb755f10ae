// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/cube/tracks.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "common/image/corners.h"

namespace cairn::cube {
namespace {

constexpr int kHalf = 7;  ///< half side of a patch [px]
constexpr int kSide = 2 * kHalf + 1;
constexpr int kPixels = kSide * kSide;
constexpr int kBorder = 12;  ///< the digitizer leaves black margins
constexpr int kWarp = 6;
constexpr int kUnknowns = kWarp + 2;
constexpr int kFastThreshold = 10;

using Vector8 = Eigen::Matrix<double, kUnknowns, 1>;
using Jacobian = Eigen::Matrix<double, kPixels, kUnknowns>;

/// A frame smoothed a little, so that cubic samples of it and their gradients are true.
cv::Mat smoothed(const GrayImage& frame) {
  const cv::Mat grey(frame.height(), frame.width(), CV_8UC1, const_cast<uint8_t*>(frame.row(0)),
                     static_cast<size_t>(frame.stride()));
  cv::Mat as_float, out;
  grey.convertTo(as_float, CV_32F);
  cv::GaussianBlur(as_float, out, {}, 0.8);
  return out;
}

/// Catmull-Rom weights of the four samples about a fraction.
std::array<double, 4> cubic_weights(double f) {
  return {0.5 * f * (-1 + f * (2 - f)), 0.5 * (2 + f * f * (-5 + 3 * f)), 0.5 * f * (1 + f * (4 - 3 * f)),
          0.5 * f * f * (f - 1)};
}

double sample(const cv::Mat& image, const Eigen::Vector2d& p) {
  const int x = static_cast<int>(std::floor(p.x()));
  const int y = static_cast<int>(std::floor(p.y()));
  const std::array<double, 4> wx = cubic_weights(p.x() - x);
  const std::array<double, 4> wy = cubic_weights(p.y() - y);
  double sum = 0;
  for (int j = 0; j < 4; ++j) {
    const float* row = image.ptr<float>(y - 1 + j) + x - 1;
    sum += wy[static_cast<size_t>(j)] * (wx[0] * row[0] + wx[1] * row[1] + wx[2] * row[2] + wx[3] * row[3]);
  }
  return sum;
}

bool inside(const cv::Mat& image, const Eigen::Vector2d& p, double border) {
  return p.x() >= border && p.y() >= border && p.x() < image.cols - 1 - border &&
         p.y() < image.rows - 1 - border;
}

struct Warp2 {
  Eigen::Matrix2d linear = Eigen::Matrix2d::Identity();
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();  ///< pixel of the patch's middle
};

/// Patch of a reference view with what its alignment needs.
struct Patch {
  Eigen::Matrix<double, kPixels, 1> pixels;
  Jacobian jacobian;  ///< by (linear xx, xy, yx, yy, x, y, gain, bias)
  Eigen::LDLT<Eigen::Matrix<double, kUnknowns, kUnknowns>> normal;
};

Eigen::Vector2d offset(int i) {
  return {i % kSide - kHalf, i / kSide - kHalf};
}

Patch cut(const cv::Mat& image, const Eigen::Vector2d& centre) {
  Patch patch;
  for (int i = 0; i < kPixels; ++i) {
    const Eigen::Vector2d d = offset(i);
    const Eigen::Vector2d p = centre + d;
    const double gx =
        0.5 * (sample(image, p + Eigen::Vector2d(1, 0)) - sample(image, p - Eigen::Vector2d(1, 0)));
    const double gy =
        0.5 * (sample(image, p + Eigen::Vector2d(0, 1)) - sample(image, p - Eigen::Vector2d(0, 1)));
    patch.pixels[i] = sample(image, p);
    patch.jacobian.row(i) << gx * d.x(), gx * d.y(), gy * d.x(), gy * d.y(), gx, gy, patch.pixels[i], 1;
  }
  patch.normal.compute(patch.jacobian.transpose() * patch.jacobian);
  return patch;
}

struct Alignment {
  Warp2 warp;
  double correlation = 0;
};

double correlation(const Eigen::Matrix<double, kPixels, 1>& a, const Eigen::Matrix<double, kPixels, 1>& b) {
  const Eigen::Matrix<double, kPixels, 1> da = a.array() - a.mean();
  const Eigen::Matrix<double, kPixels, 1> db = b.array() - b.mean();
  return da.dot(db) / std::max(1e-9, da.norm() * db.norm());
}

/// Aligns a patch from `start`; nothing when it does not converge or leaves the image.
std::optional<Alignment> align(const Patch& patch, const cv::Mat& image, const Warp2& start) {
  constexpr int kIterations = 40;
  constexpr double kMaxShift = 3;
  constexpr double kConverged = 0.002;
  Warp2 warp = start;
  Eigen::Matrix<double, kPixels, 1> seen;
  double gain = 1, bias = 0;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    for (int i = 0; i < kPixels; ++i) {
      const Eigen::Vector2d p = warp.linear * offset(i) + warp.centre;
      if (!inside(image, p, 2)) return std::nullopt;
      seen[i] = sample(image, p);
    }
    // Gain and bias map the image to the patch, so that the Jacobian stays the patch's.
    const Eigen::Matrix<double, kPixels, 1> error = (gain * seen).array() + bias - patch.pixels.array();
    const Vector8 step = patch.normal.solve(patch.jacobian.transpose() * error);
    Eigen::Matrix2d linear;
    linear << 1 + step[0], step[1], step[2], 1 + step[3];
    if (linear.determinant() < 0.1) return std::nullopt;
    // warp <- warp o step^-1
    const Eigen::Matrix2d inverse = linear.inverse();
    warp.centre -= warp.linear * inverse * step.segment<2>(4);
    warp.linear = warp.linear * inverse;
    gain /= 1 + step[6];
    bias = (bias - step[7]) / (1 + step[6]);
    if ((warp.centre - start.centre).norm() > kMaxShift) return std::nullopt;
    if (step.segment<2>(4).norm() < kConverged && step.head<4>().norm() < kConverged) {
      return Alignment{warp, correlation(seen, patch.pixels)};
    }
  }
  return std::nullopt;
}

/// Corners of a view, best first, thinned to the spacing, off the dots and off the patches already there.
std::vector<Eigen::Vector2d> choose(const GrayImage& frame, const std::vector<Eigen::Vector2d>& dots,
                                    const std::vector<Eigen::Vector2d>& taken, const TrackOptions& options) {
  CornerList corners;
  detect_fast10(frame.view(), kFastThreshold, &corners);
  std::vector<Candidate> candidates = find_candidates(frame.view(), corners, kFastThreshold, kBorder + kHalf);
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
  std::vector<Eigen::Vector2d> chosen;
  const auto near = [](const std::vector<Eigen::Vector2d>& points, const Eigen::Vector2d& p,
                       double distance) {
    return std::any_of(points.begin(), points.end(),
                       [&](const Eigen::Vector2d& q) { return (p - q).norm() < distance; });
  };
  for (const Candidate& c : candidates) {
    if (chosen.size() == options.patches_per_view) break;
    const Eigen::Vector2d p(c.corner.x, c.corner.y);
    if (near(dots, p, options.keep_off_dots) || near(taken, p, options.spacing) ||
        near(chosen, p, options.spacing)) {
      continue;
    }
    chosen.push_back(p);
  }
  return chosen;
}

class Follower {
 public:
  Follower(const std::vector<GrayImage>& frames, const std::vector<int>& views,
           const std::vector<DotSighting>& dots, const TrackOptions& options)
      : frames_(frames), views_(views), options_(options), dots_(views.size()) {
    for (const int view : views) images_.push_back(smoothed(frames[static_cast<size_t>(view)]));
    for (const DotSighting& dot : dots) {
      const auto at = std::lower_bound(views.begin(), views.end(), dot.frame);
      if (at != views.end() && *at == dot.frame)
        dots_[static_cast<size_t>(at - views.begin())].push_back(dot);
    }
  }

  /// Adds the tracks of the patches of one view.
  void follow_from(size_t reference, std::vector<Track>* tracks) const {
    std::vector<Eigen::Vector2d> dots, taken;
    for (const DotSighting& dot : dots_[reference]) dots.push_back(dot.pixel);
    for (const Track& track : *tracks) {
      for (const Track::Sighting& s : track.sightings) {
        if (s.frame == views_[reference]) taken.push_back(s.pixel);
      }
    }
    const GrayImage& frame = frames_[static_cast<size_t>(views_[reference])];
    for (const Eigen::Vector2d& centre : choose(frame, dots, taken, options_)) {
      const Patch patch = cut(images_[reference], centre);
      Track track;
      track.sightings.push_back({views_[reference], centre});
      follow(patch, centre, reference, 1, &track);
      follow(patch, centre, reference, -1, &track);
      if (track.sightings.size() < options_.min_length) continue;
      std::sort(track.sightings.begin(), track.sightings.end(),
                [](const Track::Sighting& a, const Track::Sighting& b) { return a.frame < b.frame; });
      tracks->push_back(std::move(track));
    }
  }

 private:
  void follow(const Patch& patch, const Eigen::Vector2d& centre, size_t reference, int step,
              Track* track) const {
    Warp2 warp{Eigen::Matrix2d::Identity(), centre};
    const auto end = static_cast<ptrdiff_t>(views_.size());
    for (auto view = static_cast<ptrdiff_t>(reference) + step; view >= 0 && view < end; view += step) {
      const auto now = static_cast<size_t>(view);
      const auto before = static_cast<size_t>(view - step);
      warp.centre += mean_motion(dots_[before], dots_[now]);
      if (!inside(images_[now], warp.centre, kBorder)) return;
      const auto aligned = align(patch, images_[now], warp);
      if (!aligned || aligned->correlation < options_.min_correlation) return;
      warp = aligned->warp;
      if (!inside(images_[now], warp.centre, kBorder)) return;
      track->sightings.push_back({views_[now], warp.centre});
    }
  }

  const std::vector<GrayImage>& frames_;
  const std::vector<int>& views_;
  const TrackOptions& options_;
  std::vector<cv::Mat> images_;
  std::vector<std::vector<DotSighting>> dots_;
};

}  // namespace

std::vector<Track> follow_patches(const std::vector<GrayImage>& frames, const std::vector<int>& views,
                                  const std::vector<DotSighting>& dots, const TrackOptions& options) {
  const Follower follower(frames, views, dots, options);
  std::vector<Track> tracks;
  for (int i = 0; i < options.references; ++i) {
    const size_t last = views.size() - 1;
    follower.follow_from(last * static_cast<size_t>(i) / static_cast<size_t>(options.references - 1),
                         &tracks);
  }
  return tracks;
}

}  // namespace cairn::cube
