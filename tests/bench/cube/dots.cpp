// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/cube/dots.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>

namespace cairn::cube {
namespace {

constexpr int kFrames = 80;
constexpr int kWindow = 10;        ///< half side of the window in which a blob is looked for, px
constexpr int kMinBlobPixels = 7;  ///< smaller ones have no centroid worth having
constexpr int kMaxBlobPixels = 120;
constexpr int kMinContrast = 60;     ///< grey levels between dot and face
constexpr double kMaxMiss = 2.5;     ///< px between where a dot is looked for and where it is
constexpr double kMinSpread = 0.6;   ///< px: least standard deviation of a dot's light in any direction
constexpr double kMaxMisfit = 0.35;  ///< px off the face's homography: another dot, or one run into an edge

/// Corner dots of a face in an image: (first, first), (last column, first row), (last, last), (first column,
/// last row). Read off the images, good to 2 px.
using Corners = std::array<Eigen::Vector2d, 4>;

Corners corner_pixels(Face face) {
  switch (face) {
    case Face::kTop:  // frame 0
      return {{{193.3, 87.0}, {240.0, 84.0}, {243.7, 128.7}, {196.7, 132.3}}};
    case Face::kFront:  // frame 79
      return {{{147.7, 156.7}, {211.3, 151.7}, {199.3, 172.7}, {139.3, 177.7}}};
    case Face::kLeft:  // frame 79
      break;
  }
  return {{{117.0, 91.7}, {129.3, 145.0}, {121.3, 166.7}, {110.0, 115.7}}};
}

Eigen::Vector2d grid_point(const Dot& dot) {
  return {dot.column, dot.row};
}

Eigen::Vector2d apply(const Eigen::Matrix3d& h, const Eigen::Vector2d& p) {
  return (h * p.homogeneous()).hnormalized();
}

Eigen::Matrix3d corner_homography(Face face) {
  const double u = columns(face) - 1;
  const double v = rows(face) - 1;
  const Corners corners = corner_pixels(face);
  return fit_homography({{0, 0}, {u, 0}, {u, v}, {0, v}}, {corners.begin(), corners.end()});
}

Eigen::Matrix3d homography_of(const std::vector<DotSighting>& sightings) {
  std::vector<Eigen::Vector2d> grid, pixels;
  for (const DotSighting& s : sightings) {
    grid.push_back(grid_point(s.dot));
    pixels.push_back(s.pixel);
  }
  return fit_homography(grid, pixels);
}

/// The dots of one face in one frame, near where `pixel_from_grid` says. Those that a homography of the
/// others contradicts are left out, worst first.
std::vector<DotSighting> find_face(const GrayView& image, Face face, int frame,
                                   const Eigen::Matrix3d& pixel_from_grid, const Eigen::Vector2d& motion) {
  std::vector<DotSighting> found;
  for (const Dot& dot : dots_of(face)) {
    const auto centre = dot_centroid(image, apply(pixel_from_grid, grid_point(dot)) + motion);
    if (centre) found.push_back({frame, dot, *centre});
  }
  while (found.size() >= 6) {
    const Eigen::Matrix3d h = homography_of(found);
    const auto misfit = [&](const DotSighting& s) { return (apply(h, grid_point(s.dot)) - s.pixel).norm(); };
    const auto worst =
        std::max_element(found.begin(), found.end(),
                         [&](const DotSighting& a, const DotSighting& b) { return misfit(a) < misfit(b); });
    if (misfit(*worst) <= kMaxMisfit) return found;
    found.erase(worst);
  }
  return {};
}

/// Follows one face from `first` to `last` (either way), until it is no longer seen.
std::vector<DotSighting> follow_face(const std::vector<GrayImage>& frames, Face face, int first, int last) {
  std::vector<DotSighting> all;
  Eigen::Matrix3d pixel_from_grid = corner_homography(face);
  Eigen::Vector2d motion = Eigen::Vector2d::Zero();  ///< of the face's middle from frame to frame
  const Eigen::Vector2d middle(0.5 * (columns(face) - 1), 0.5 * (rows(face) - 1));
  const int step = first < last ? 1 : -1;
  for (int frame = first; frame != last + step; frame += step) {
    const std::vector<DotSighting> found =
        find_face(frames[static_cast<size_t>(frame)].view(), face, frame, pixel_from_grid, motion);
    if (found.empty()) break;
    const Eigen::Matrix3d now = homography_of(found);
    motion = frame == first ? Eigen::Vector2d::Zero().eval()
                            : (apply(now, middle) - apply(pixel_from_grid, middle)).eval();
    pixel_from_grid = now;
    all.insert(all.end(), found.begin(), found.end());
  }
  return all;
}

struct Window {
  int left, top, right, bottom;  ///< inclusive
};

struct Levels {
  double dark, bright;
};

/// Grey of the face and of its dots about a place: quantiles, since a window holds mostly face.
Levels levels_in(const GrayView& image, const Window& window, const Eigen::Vector2d& near) {
  std::vector<uint8_t> greys;
  uint8_t bright = 0;
  for (int y = window.top; y <= window.bottom; ++y) {
    for (int x = window.left; x <= window.right; ++x) {
      greys.push_back(image.at(x, y));
      if (std::abs(x - near.x()) <= kMaxMiss && std::abs(y - near.y()) <= kMaxMiss) {
        bright = std::max(bright, image.at(x, y));
      }
    }
  }
  const auto quarter = greys.begin() + static_cast<ptrdiff_t>(greys.size() / 4);
  std::nth_element(greys.begin(), quarter, greys.end());
  return {static_cast<double>(*quarter), static_cast<double>(bright)};
}

/// The pixels above `threshold` that hang together with `start` (4-neighbours); empty when they touch the
/// window's border.
std::vector<Eigen::Vector2i> blob_at(const GrayView& image, const Window& window,
                                     const Eigen::Vector2i& start, double threshold) {
  std::vector<Eigen::Vector2i> blob{start};
  for (size_t i = 0; i < blob.size(); ++i) {
    const Eigen::Vector2i p = blob[i];
    if (p.x() == window.left || p.x() == window.right || p.y() == window.top || p.y() == window.bottom) {
      return {};
    }
    for (const Eigen::Vector2i& step : {Eigen::Vector2i(1, 0), {-1, 0}, {0, 1}, {0, -1}}) {
      const Eigen::Vector2i q = p + step;
      if (image.at(q.x(), q.y()) <= threshold) continue;
      if (std::find(blob.begin(), blob.end(), q) == blob.end()) blob.push_back(q);
    }
  }
  return blob;
}

/// The blob and what of its blurred rim lies below the threshold: two pixels around, downhill only, so that
/// what shines beyond the rim stays out.
std::vector<Eigen::Vector2i> with_rim(const GrayView& image, std::vector<Eigen::Vector2i> blob) {
  constexpr int kRim = 2;
  size_t begin = 0;
  for (int ring = 0; ring < kRim; ++ring) {
    const size_t end = blob.size();
    for (size_t i = begin; i < end; ++i) {
      for (const Eigen::Vector2i& step : {Eigen::Vector2i(1, 0), {-1, 0}, {0, 1}, {0, -1}}) {
        const Eigen::Vector2i q = blob[i] + step;
        if (q.x() < 0 || q.y() < 0 || q.x() >= image.width || q.y() >= image.height) continue;
        if (image.at(q.x(), q.y()) > image.at(blob[i].x(), blob[i].y())) continue;
        if (std::find(blob.begin(), blob.end(), q) == blob.end()) blob.push_back(q);
      }
    }
    begin = ring == 0 ? end : begin;
  }
  return blob;
}

}  // namespace

int columns(Face /*face*/) {
  return 4;
}
int rows(Face face) {
  return face == Face::kTop ? 4 : 3;
}

std::vector<Dot> dots_of(Face face) {
  std::vector<Dot> dots;
  for (int row = 0; row < rows(face); ++row) {
    for (int column = 0; column < columns(face); ++column) {
      const bool inside = row > 0 && row < rows(face) - 1 && column > 0 && column < columns(face) - 1;
      if (!inside) dots.push_back({face, column, row});
    }
  }
  return dots;
}

Eigen::Matrix3d fit_homography(const std::vector<Eigen::Vector2d>& from,
                               const std::vector<Eigen::Vector2d>& to) {
  const auto n = static_cast<Eigen::Index>(from.size());
  Eigen::MatrixXd a(2 * n, 8);
  Eigen::VectorXd b(2 * n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Vector2d& p = from[static_cast<size_t>(i)];
    const Eigen::Vector2d& q = to[static_cast<size_t>(i)];
    a.row(2 * i) << p.x(), p.y(), 1, 0, 0, 0, -q.x() * p.x(), -q.x() * p.y();
    a.row(2 * i + 1) << 0, 0, 0, p.x(), p.y(), 1, -q.y() * p.x(), -q.y() * p.y();
    b.segment<2>(2 * i) = q;
  }
  const Eigen::Matrix<double, 8, 1> h = a.colPivHouseholderQr().solve(b);
  Eigen::Matrix3d result;
  result << h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1;
  return result;
}

Result<Eigen::Vector2d> dot_centroid(const GrayView& image, const Eigen::Vector2d& near) {
  if (!near.allFinite() || !image.contains(static_cast<float>(near.x()), static_cast<float>(near.y()), 4)) {
    return fail(ErrorCode::kNotFound, "outside the image");
  }
  const int cx = static_cast<int>(std::lround(near.x()));
  const int cy = static_cast<int>(std::lround(near.y()));
  const Window window{std::max(0, cx - kWindow), std::max(0, cy - kWindow),
                      std::min(image.width - 1, cx + kWindow), std::min(image.height - 1, cy + kWindow)};
  const Levels levels = levels_in(image, window, near);
  if (levels.bright - levels.dark < kMinContrast) return fail(ErrorCode::kNotFound, "no dot: no contrast");

  const double threshold = 0.5 * (levels.dark + levels.bright);
  Eigen::Vector2i start(cx, cy);
  for (int y = cy - 2; y <= cy + 2; ++y) {
    for (int x = cx - 2; x <= cx + 2; ++x) {
      if (image.at(x, y) > image.at(start.x(), start.y())) start = {x, y};
    }
  }
  const std::vector<Eigen::Vector2i> blob = blob_at(image, window, start, threshold);
  if (blob.size() < kMinBlobPixels || blob.size() > kMaxBlobPixels) {
    return fail(ErrorCode::kNotFound, "no dot: not a closed blob of its size");
  }

  const std::vector<Eigen::Vector2i> dot = with_rim(image, blob);
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();
  double total = 0;
  for (const Eigen::Vector2i& p : dot) {
    // Negative in the rim now and then: so the noise of the face does not pull.
    const double weight = image.at(p.x(), p.y()) - levels.dark;
    const Eigen::Vector2d q = p.cast<double>();
    centre += weight * q;
    spread += weight * q * q.transpose();
    total += weight;
  }
  centre /= total;
  spread = spread / total - centre * centre.transpose();
  const double half_trace = 0.5 * spread.trace();
  const double least = half_trace - std::sqrt(std::max(0.0, half_trace * half_trace - spread.determinant()));
  if (least < kMinSpread * kMinSpread) return fail(ErrorCode::kNotFound, "no dot: too narrow");
  if ((centre - near).norm() > kMaxMiss) return fail(ErrorCode::kNotFound, "no dot: too far off");
  return centre;
}

Eigen::Vector2d mean_motion(const std::vector<DotSighting>& from, const std::vector<DotSighting>& to) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  int n = 0;
  for (const DotSighting& a : from) {
    for (const DotSighting& b : to) {
      if (!(a.dot == b.dot)) continue;
      sum += b.pixel - a.pixel;
      ++n;
    }
  }
  return n > 0 ? (sum / n).eval() : sum;
}

Result<std::vector<DotSighting>> follow_dots(const std::vector<GrayImage>& frames) {
  if (frames.size() != kFrames) return fail(ErrorCode::kDamaged, "the cube sequence has 80 frames");
  for (const GrayImage& frame : frames) {
    if (frame.width() != 384 || frame.height() != 288) {
      return fail(ErrorCode::kDamaged, "the frames of the cube sequence are of 384x288 px");
    }
  }
  std::vector<DotSighting> all = follow_face(frames, Face::kTop, 0, kFrames - 1);
  if (all.size() != kFrames * dots_of(Face::kTop).size()) {
    return fail(ErrorCode::kDamaged, "the top face's dots are not all seen in all frames: other images?");
  }
  for (const Face face : {Face::kFront, Face::kLeft}) {
    const std::vector<DotSighting> side = follow_face(frames, face, kFrames - 1, 0);
    all.insert(all.end(), side.begin(), side.end());
  }
  return all;
}

std::vector<int> moving_frames(const std::vector<DotSighting>& sightings, double min_motion) {
  std::map<int, std::vector<DotSighting>> by_frame;
  for (const DotSighting& s : sightings) by_frame[s.frame].push_back(s);
  std::vector<int> frames;
  for (const auto& [frame, seen] : by_frame) {
    if (frames.empty() || mean_motion(by_frame[frames.back()], seen).norm() >= min_motion) {
      frames.push_back(frame);
    }
  }
  return frames;
}

}  // namespace cairn::cube
