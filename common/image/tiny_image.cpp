// SPDX-License-Identifier: Apache-2.0
#include "common/image/tiny_image.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include "common/base/simd.h"

namespace cairn {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr int kLanes = 4;  ///< every processor has these: no dispatch, and the same sums on every machine

// ---- Blur

/// One half of a normalized Gaussian: weights of distances 0 .. radius.
void gaussian(float sigma, int radius, float* weights) {
  float sum = 0;
  for (int i = 0; i <= radius; ++i) {
    const float z = static_cast<float>(i) / sigma;
    weights[i] = std::exp(-0.5F * z * z);
    sum += i == 0 ? weights[i] : 2 * weights[i];
  }
  for (int i = 0; i <= radius; ++i) weights[i] /= sum;
}

void blur_rows(const float* in, int width, int height, const float* weights, int radius, float* padded,
               float* out) {
  for (int y = 0; y < height; ++y, in += width, out += width) {
    std::fill_n(padded, radius, in[0]);
    std::copy_n(in, width, padded + radius);
    std::fill_n(padded + radius + width, radius, in[width - 1]);
    const float* center = padded + radius;
    for (int x = 0; x < width; ++x) out[x] = weights[0] * center[x];
    for (int i = 1; i <= radius; ++i) {
      for (int x = 0; x < width; ++x) out[x] += weights[i] * (center[x - i] + center[x + i]);
    }
  }
}

void blur_columns(const float* in, int width, int height, const float* weights, int radius, float* out) {
  for (int y = 0; y < height; ++y, out += width) {
    const float* center = in + y * width;
    for (int x = 0; x < width; ++x) out[x] = weights[0] * center[x];
    for (int i = 1; i <= radius; ++i) {
      const float* above = in + std::max(y - i, 0) * width;
      const float* below = in + std::min(y + i, height - 1) * width;
      for (int x = 0; x < width; ++x) out[x] += weights[i] * (above[x] + below[x]);
    }
  }
}

// ---- Alignment

constexpr int kMaxAlignWidth = 512;  ///< px; bounds the rows kept on the stack

/// Sums of the normal equations of one pass. The unknowns are (x, y, angle) of a motion applied to the
/// reference before the present one, and the mean offset.
struct NormalEquations {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Zero();
  Eigen::Vector4d vector = Eigen::Vector4d::Zero();
  double squared_residuals = 0;
  double count = 0;

  /// Mean squared residual, mean offset removed.
  [[nodiscard]] double score() const {
    const double mean = vector(3) / count;
    return squared_residuals / count - mean * mean;
  }
};

/// One row of the current image, sampled where the motion puts the pixels of a reference row; [begin, end)
/// lie in the image.
struct WarpedRow {
  std::array<float, kMaxAlignWidth> values;
  std::array<float, kMaxAlignWidth> weights;  ///< of the current image's nearest pixels
  int begin = 0;
  int end = 0;
};

class Aligner {
 public:
  Aligner(const TinyImage& reference, const TinyImage& current)
      : reference_(reference),
        current_(current),
        center_(0.5F * static_cast<float>(reference.width() - 1),
                0.5F * static_cast<float>(reference.height() - 1)) {}

  /// Normal equations of efficient second-order minimization at `motion`: the Jacobian is the mean of the
  /// gradients of the reference and of the warped current image (Benhimane and Malis 2004, eq. 14), both in
  /// reference coordinates.
  NormalEquations linearize(const TinyMotion& motion) {
    Sums sums{};
    for (int y = 0; y < reference_.height(); ++y) {
      warp_row(motion, y);
      if (y >= 2) add_row(y - 1, &sums);
    }
    return finish(sums);
  }

 private:
  // Products of the Jacobian (x, y, t for the angle), the residual r and 1.
  enum Product { kXX, kXY, kXT, kX, kYY, kYT, kY, kTT, kT, kXR, kYR, kTR, kR, kRR, kOne, kProducts };
  struct Sums {
    F32x4 of[kProducts];  // not std::array: a vector as a template argument loses its alignment
  };

  WarpedRow& row(int y) { return rows_[static_cast<size_t>(y % 3)]; }

  /// The line in the current image on which the pixels of a row lie: (u, v) = (u0 + c dx, v0 + s dx), dx from
  /// the row's middle.
  struct RowPath {
    float u0;
    float v0;
    float c;
    float s;
  };

  void warp_row(const TinyMotion& motion, int y) {
    const float c = std::cos(motion.angle);
    const float s = std::sin(motion.angle);
    const float dy = static_cast<float>(y) - center_.y();
    const RowPath path{center_.x() + motion.shift.x() - s * dy, center_.y() + motion.shift.y() + c * dy, c,
                       s};
    WarpedRow& out = row(y);
    // The pixels that stay inside are neighbours: u and v are monotonic along the row, also as rounded.
    out.begin = out.end = 0;
    const int width = current_.width();
    int x = 0;
    for (; x + kLanes <= width; x += kLanes) {
      if (!warp_group(path, x, &out)) warp_pixels(path, x, x + kLanes, &out);
    }
    warp_pixels(path, x, width, &out);
  }

  static void extend(int begin, int end, WarpedRow* row) {
    if (row->end == 0) row->begin = begin;
    row->end = end;
  }

  void warp_pixels(const RowPath& path, int begin, int end, WarpedRow* out) const {
    const int width = current_.width();
    const int height = current_.height();
    for (int x = begin; x < end; ++x) {
      const float dx = static_cast<float>(x) - center_.x();
      const float u = path.u0 + path.c * dx;
      const float v = path.v0 + path.s * dx;
      if (!(u >= 0 && v >= 0 && u <= static_cast<float>(width - 1) && v <= static_cast<float>(height - 1)))
        continue;
      extend(x, x + 1, out);
      const int iu = std::min(static_cast<int>(u), width - 2);
      const int iv = std::min(static_cast<int>(v), height - 2);
      const float fu = u - static_cast<float>(iu);
      const float fv = v - static_cast<float>(iv);
      const float* p = current_.values().data() + iv * width + iu;
      const float top = p[0] + fu * (p[1] - p[0]);
      const float bottom = p[width] + fu * (p[width + 1] - p[width]);
      out->values[static_cast<size_t>(x)] = top + fv * (bottom - top);
      const int nearest = (iv + (fv > 0.5F ? 1 : 0)) * width + iu + (fu > 0.5F ? 1 : 0);
      out->weights[static_cast<size_t>(x)] = current_.weights()[static_cast<size_t>(nearest)];
    }
  }

  /// The same for as many pixels as there are lanes; false when one of them is outside. Whole numbers as
  /// floats: they are far below 2^24.
  [[nodiscard]] bool warp_group(const RowPath& path, int x, WarpedRow* out) const {
    const int width = current_.width();
    const auto max_u = static_cast<float>(width - 1);
    const auto max_v = static_cast<float>(current_.height() - 1);
    const F32x4 lane = {0, 1, 2, 3};
    const F32x4 dx = static_cast<float>(x) + lane - center_.x();
    const F32x4 u = path.u0 + path.c * dx;
    const F32x4 v = path.v0 + path.s * dx;
    if (lane_bits((u >= 0.0F) & (v >= 0.0F) & (u <= max_u) & (v <= max_v)) != (1 << kLanes) - 1) return false;
    extend(x, x + kLanes, out);
    const auto floor_below = [](F32x4 at, float limit) {
      const F32x4 floor = __builtin_convertvector(__builtin_convertvector(at, I32x4), F32x4);
      return smaller(floor, F32x4{} + limit);
    };
    const F32x4 iu = floor_below(u, max_u - 1);
    const F32x4 iv = floor_below(v, max_v - 1);
    const F32x4 fu = u - iu;
    const F32x4 fv = v - iv;
    const auto indices = [&](F32x4 across, F32x4 down) {
      std::array<int, kLanes> index;
      store_lanes(index.data(), __builtin_convertvector(down * static_cast<float>(width) + across, I32x4));
      return index;
    };
    const auto at = indices(iu, iv);
    const auto blend = [](F32x4 a, F32x4 b, F32x4 share) { return a + share * (b - a); };
    const auto between = [&](const float* pixels) {
      const F32x4 a = load_pairs(pixels + at[0], pixels + at[1]);
      const F32x4 b = load_pairs(pixels + at[2], pixels + at[3]);
      return blend(CAIRN_LANES(a, b, 0, 2, 4, 6), CAIRN_LANES(a, b, 1, 3, 5, 7), fu);
    };
    const float* pixels = current_.values().data();
    store_lanes(&out->values[static_cast<size_t>(x)], blend(between(pixels), between(pixels + width), fv));
    const auto rounded_up = [](F32x4 fraction) { return fraction > 0.5F ? F32x4{} + 1.0F : F32x4{}; };
    const auto nearest = indices(iu + rounded_up(fu), iv + rounded_up(fv));
    for (size_t i = 0; i < nearest.size(); ++i)
      out->weights[static_cast<size_t>(x) + i] = current_.weights()[static_cast<size_t>(nearest[i])];
    return true;
  }

  /// Adds the pixels of row y of which all four neighbours are known.
  void add_row(int y, Sums* sums) {
    const WarpedRow& above = row(y - 1);
    const WarpedRow& here = row(y);
    const WarpedRow& below = row(y + 1);
    const int begin = std::max({here.begin + 1, above.begin, below.begin});
    const int end = std::min({here.end - 1, above.end, below.end});
    if (end - begin < kLanes) return;
    for (int x = begin; x < end; x += kLanes) {
      // The last group overlaps the one before; lanes that were counted get weight 0.
      const int first = std::min(x, end - kLanes);
      add_group(above, here, below, first, y, x - first, sums);
    }
  }

  void add_group(const WarpedRow& above, const WarpedRow& here, const WarpedRow& below, int x, int y,
                 int skip, Sums* sums) const {
    const int width = reference_.width();
    const float* ref = reference_.values().data() + y * width + x;
    const float* cur = here.values.data() + x;
    const auto four = [](const float* p) { return load_lanes<F32x4>(p); };
    const F32x4 lane = {0, 1, 2, 3};
    const F32x4 counts = four(reference_.weights().data() + y * width + x) * four(here.weights.data() + x);
    const F32x4 weight = lane >= static_cast<float>(skip) ? counts : F32x4{};
    const F32x4 quarter = weight * 0.25F;  // mean of two central differences over two pixels
    const F32x4 ref_x = four(ref + 1) - four(ref - 1);
    const F32x4 ref_y = four(ref + width) - four(ref - width);
    const F32x4 cur_x = four(cur + 1) - four(cur - 1);
    const F32x4 cur_y = four(below.values.data() + x) - four(above.values.data() + x);
    const F32x4 jx = quarter * (ref_x + cur_x);
    const F32x4 jy = quarter * (ref_y + cur_y);
    const F32x4 dx = lane + (static_cast<float>(x) - center_.x());
    const float dy = static_cast<float>(y) - center_.y();
    const F32x4 jt = dx * jy - dy * jx;
    const F32x4 r = weight * (four(cur) - four(ref));
    const auto add = [&](Product p, F32x4 value) { sums->of[p] += value; };
    add(kXX, jx * jx);
    add(kXY, jx * jy);
    add(kXT, jx * jt);
    add(kX, jx);
    add(kYY, jy * jy);
    add(kYT, jy * jt);
    add(kY, jy);
    add(kTT, jt * jt);
    add(kT, jt);
    add(kXR, jx * r);
    add(kYR, jy * r);
    add(kTR, jt * r);
    add(kR, r);
    add(kRR, r * r);
    add(kOne, weight);
  }

  static NormalEquations finish(const Sums& sums) {
    std::array<double, kProducts> s{};
    for (size_t i = 0; i < kProducts; ++i) s[i] = sum_of_lanes(sums.of[i]);
    NormalEquations equations;
    equations.matrix << s[kXX], s[kXY], s[kXT], s[kX],  //
        s[kXY], s[kYY], s[kYT], s[kY],                  //
        s[kXT], s[kYT], s[kTT], s[kT],                  //
        s[kX], s[kY], s[kT], s[kOne];
    equations.vector << s[kXR], s[kYR], s[kTR], s[kR];
    equations.squared_residuals = s[kRR];
    equations.count = s[kOne];
    return equations;
  }

  const TinyImage& reference_;
  const TinyImage& current_;
  Eigen::Vector2f center_;
  std::array<WarpedRow, 3> rows_;  ///< the last three, by y modulo 3
};

/// Pixels between neighbouring ones of a level that many halvings above level 0.
int tiny_scale(int camera_width, int tiny_width) {
  const double ratio = static_cast<double>(camera_width) / std::max(tiny_width, 1);
  return 1 << std::max(static_cast<int>(std::lround(std::log2(ratio))), 0);
}

/// Right-handed orthonormal frame that two unit rays define symmetrically: their bisector, their difference,
/// the normal.
Eigen::Matrix3d frame_of_rays(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  Eigen::Matrix3d frame;
  frame.col(0) = (a + b).normalized();
  frame.col(1) = (b - a).normalized();
  frame.col(2) = frame.col(0).cross(frame.col(1));
  return frame;
}

}  // namespace

/// Pixels that stand still become the mean of the others, so that the blur brings no edge; what the blur
/// mixes with them does not count either.
void TinyImage::leave_out(const StillMask& still) {
  const auto is_still = [&](int x, int y) {
    const int u = std::min(2 * x, still.width() - 1);
    const int v = std::min(2 * y, still.height() - 1);
    const int right = std::min(u + 1, still.width() - 1);
    const int down = std::min(v + 1, still.height() - 1);
    return still.is_still(u, v) || still.is_still(right, v) || still.is_still(u, down) ||
           still.is_still(right, down);
  };
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      if (!is_still(x, y)) continue;
      for (int v = std::max(0, y - 1); v <= std::min(height_ - 1, y + 1); ++v) {
        for (int u = std::max(0, x - 1); u <= std::min(width_ - 1, x + 1); ++u)
          weights_[static_cast<size_t>(v * width_ + u)] = 0;
      }
    }
  }
  float sum = 0;
  size_t count = 0;
  for (size_t i = 0; i < weights_.size(); ++i) {
    sum += weights_[i] * values_[i];
    count += weights_[i] > 0 ? 1 : 0;
  }
  count_ = count;
  const float mean = sum / static_cast<float>(std::max<size_t>(1, count));
  for (size_t i = 0; i < weights_.size(); ++i) values_[i] = weights_[i] > 0 ? values_[i] : mean;
}

void TinyImage::subtract_mean() {
  double sum = 0;
  for (size_t i = 0; i < values_.size(); ++i) sum += weights_[i] * values_[i];
  const auto mean = static_cast<float>(sum / static_cast<double>(std::max<size_t>(1, count_)));
  for (size_t i = 0; i < values_.size(); ++i) values_[i] = weights_[i] * (values_[i] - mean);
}

void TinyImage::assign(const GrayView& level3, float sigma, const StillMask* still) {
  width_ = level3.width / 2;
  height_ = level3.height / 2;
  const size_t n = static_cast<size_t>(width_) * static_cast<size_t>(height_);
  const int radius = sigma > 0 ? static_cast<int>(std::ceil(3 * sigma)) : 0;
  const size_t padded_width = static_cast<size_t>(width_) + 2 * static_cast<size_t>(radius);
  weights_.assign(n, 1);
  count_ = n;
  if (n == 0) {
    values_.clear();
    return;
  }
  // Behind the image lies, for the time of the blur, its scratch: weights, a padded row, the image blurred
  // one way.
  values_.resize(2 * n + padded_width + static_cast<size_t>(radius) + 1);
  for (int y = 0; y < height_; ++y) {
    const uint8_t* top = level3.row(2 * y);
    const uint8_t* bottom = level3.row(2 * y + 1);
    float* out = values_.data() + static_cast<ptrdiff_t>(y) * width_;
    for (int x = 0; x < width_; ++x) {
      out[x] = 0.25F * static_cast<float>(top[2 * x] + top[2 * x + 1] + bottom[2 * x] + bottom[2 * x + 1]);
    }
  }
  const bool has_mask =
      still != nullptr && still->width() == level3.width && still->height() == level3.height;
  if (has_mask) leave_out(*still);
  if (radius > 0) {
    float* half_blurred = values_.data() + n;
    float* padded = half_blurred + n;
    float* weights = padded + padded_width;
    gaussian(sigma, radius, weights);
    blur_rows(values_.data(), width_, height_, weights, radius, padded, half_blurred);
    blur_columns(half_blurred, width_, height_, weights, radius, values_.data());
  }
  values_.resize(n);
  subtract_mean();
}

float tiny_difference(const TinyImage& a, const TinyImage& b) {
  if (a.empty() || a.width() != b.width() || a.height() != b.height()) return kInfinity;
  const float* p = a.values().data();
  const float* q = b.values().data();
  const size_t n = a.values().size();
  constexpr size_t kChains = 4;  // sums in flight hide the latency of the addition
  F32x4 sums[kChains] = {};
  size_t i = 0;
  for (; i + kChains * kLanes <= n; i += kChains * kLanes) {
    for (size_t k = 0; k < kChains; ++k) {
      const F32x4 d = load_lanes<F32x4>(p + i + k * kLanes) - load_lanes<F32x4>(q + i + k * kLanes);
      sums[k] += d * d;
    }
  }
  float rest = 0;
  for (; i < n; ++i) rest += (p[i] - q[i]) * (p[i] - q[i]);
  const F32x4 sum = (sums[0] + sums[1]) + (sums[2] + sums[3]);
  return (sum_of_lanes(sum) + rest) / static_cast<float>(std::max<size_t>(1, std::min(a.count(), b.count())));
}

float tiny_correlation(const TinyImage& reference, const TinyImage& current, const TinyMotion& motion) {
  const auto mean_square = [](const TinyImage& image) {
    float sum = 0;
    for (const float v : image.values()) sum += v * v;
    return sum / static_cast<float>(std::max<size_t>(1, image.count()));
  };
  const float a = mean_square(reference);
  const float b = mean_square(current);
  const float product = 2 * std::sqrt(a * b);
  if (!std::isfinite(motion.score) || !(product > 0)) return -1;
  return std::clamp((a + b - motion.score) / product, -1.0F, 1.0F);
}

TinyMotion align_tiny(const TinyImage& reference, const TinyImage& current, int iterations) {
  constexpr double kMinOverlap = 0.25;  // of the image
  constexpr double kConverged = 1e-3;   // tiny px
  constexpr double kDamping = 1e-3;     // keeps a textureless image at rest
  TinyMotion failed{.score = kInfinity};
  const bool comparable = !reference.empty() && reference.width() == current.width() &&
                          reference.height() == current.height() && reference.width() <= kMaxAlignWidth;
  if (!comparable || reference.width() < kLanes + 2 || reference.height() < 3) return failed;
  const double min_count = kMinOverlap * (reference.width() - 2) * (reference.height() - 2);
  const double half_width = 0.5 * reference.width();

  Aligner aligner(reference, current);
  TinyMotion motion;
  NormalEquations equations = aligner.linearize(motion);
  for (int i = 0; i < iterations; ++i) {
    if (equations.count < min_count) return failed;
    equations.matrix.diagonal().head<3>().array() += kDamping;
    // r + J d - m = 0: the sign of the mean offset is of no interest, it is found anew each time.
    const Eigen::Vector4d step = -equations.matrix.ldlt().solve(equations.vector);
    if (!step.allFinite()) return failed;
    // W(p) becomes W(W_step(p)): the step acts on reference coordinates.
    motion.shift += Eigen::Rotation2Df(motion.angle) * step.head<2>().cast<float>();
    motion.angle += static_cast<float>(step(2));
    equations = aligner.linearize(motion);
    if (step.head<2>().norm() + std::abs(step(2)) * half_width < kConverged) break;
  }
  if (equations.count < min_count) return failed;
  motion.score = static_cast<float>(equations.score());
  return motion;
}

SE3 rotation_from_tiny(const TinyMotion& motion, const Camera& camera, int tiny_width) {
  constexpr double kArm = 5;  // tiny px
  const int scale = tiny_scale(camera.width(), tiny_width);
  const Eigen::Vector2i last(camera.width() / scale - 1, camera.height() / scale - 1);
  const Eigen::Vector2d center = 0.5 * last.cast<double>();
  const auto ray = [&](const Eigen::Vector2d& tiny) {
    return camera.unproject((tiny.array() + 0.5).matrix() * scale - Eigen::Vector2d(0.5, 0.5));
  };
  const Eigen::Vector2d arm(kArm, 0);
  const Eigen::Vector2d moved_arm = Eigen::Rotation2Dd(motion.angle) * arm;
  const Eigen::Vector2d moved_center = center + motion.shift.cast<double>();
  const Eigen::Matrix3d reference_rays = frame_of_rays(ray(center - arm), ray(center + arm));
  const Eigen::Matrix3d current_rays =
      frame_of_rays(ray(moved_center - moved_arm), ray(moved_center + moved_arm));
  const Eigen::Matrix3d rotation = current_rays * reference_rays.transpose();
  return {rotation, Eigen::Vector3d::Zero()};
}

}  // namespace cairn
