// SPDX-License-Identifier: Apache-2.0
#include "hw/calibration/clock_offset.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/geometry/se3.h"
#include "hw/calibration/rotation_fit.h"

namespace cairn {
namespace {

constexpr double kWidest = 0.3;   // [s] that stamps may be apart
constexpr double kCoarse = 0.01;  // [s] between tries: half a period of what a hand shakes is five of them
constexpr double kFine = 0.002;
constexpr double kLongestImage = 0.2;  // [s] between two: over more the camera turned nobody knows how
constexpr double kShortestImage = 0.005;
constexpr double kLongestGap = 0.1;     // [s] between samples
constexpr size_t kFewest = 60;          // pairs of images
constexpr double kLeastTurning = 0.15;  // [rad/s], RMS
constexpr double kLeastCorrelation = 0.7;
constexpr double kOutlier = 5;  // times the median: a jump of the tracker
constexpr double kWindow = 20;  // [s]

/// The rotation of the IMU against its first sample, at any time of the samples.
class Turning {
 public:
  explicit Turning(std::span<const GyroSample> gyro) : begin_(gyro.front().when) {
    Eigen::Quaterniond stands = Eigen::Quaterniond::Identity();
    double before = 0;
    for (const GyroSample& sample : gyro) {
      const double time = seconds_between(sample.when, begin_);
      stands = (stands * so3_exp(sample.rate * (time - before))).normalized();
      if (!marks_.empty() && time - before > kLongestGap) gaps_.push_back({before, time});
      marks_.push_back({time, stands});
      before = time;
    }
  }
  [[nodiscard]] double time_of(Timestamp stamp) const { return seconds_between(stamp, begin_); }
  /// Whether the samples reach from `from` to `to` without a gap.
  [[nodiscard]] bool covers(double from, double to) const {
    return marks_.front().time < from && to <= marks_.back().time &&
           std::none_of(gaps_.begin(), gaps_.end(),
                        [&](const Gap& gap) { return gap.from < to && from < gap.to; });
  }

  /// The rotation at a time. Nothing outside of the samples and in a gap.
  [[nodiscard]] std::optional<Eigen::Quaterniond> at(double time) const {
    const auto after = std::lower_bound(marks_.begin(), marks_.end(), time,
                                        [](const Mark& mark, double t) { return mark.time < t; });
    if (after == marks_.begin() || after == marks_.end()) return std::nullopt;
    const auto before = std::prev(after);
    const double gap = after->time - before->time;
    if (gap > kLongestGap) return std::nullopt;
    return before->stands.slerp((time - before->time) / gap, after->stands);
  }

 private:
  struct Mark {
    double time;
    Eigen::Quaterniond stands;
  };
  struct Gap {
    double from;
    double to;
  };
  Timestamp begin_;
  std::vector<Mark> marks_;
  std::vector<Gap> gaps_;
};

/// Two images and how the camera turned between them.
struct Step {
  double from;  ///< [s]
  double to;
  Eigen::Vector3d rate;  ///< [rad/s]
};

std::vector<Step> steps_of(std::span<const CameraRotation> camera, const Turning& turning) {
  std::vector<Step> steps;
  for (size_t i = 1; i < camera.size(); ++i) {
    const Step step{turning.time_of(camera[i - 1].when), turning.time_of(camera[i].when), {}};
    const double time = step.to - step.from;
    if (time < kShortestImage || time > kLongestImage) continue;
    if (!turning.covers(step.from - kWidest, step.to + kWidest)) continue;
    const Eigen::Quaterniond turn = camera[i - 1].map_from_camera.conjugate() * camera[i].map_from_camera;
    steps.push_back({step.from, step.to, so3_log(turn) / time});
  }
  return steps;
}

/// The rates of both, with the camera's stamps moved on by `offset`.
std::vector<VectorPair> pairs_at(double offset, const std::vector<Step>& steps, const Turning& turning) {
  std::vector<VectorPair> pairs;
  pairs.reserve(steps.size());
  for (const Step& step : steps) {
    const auto from = turning.at(step.from + offset);
    const auto to = turning.at(step.to + offset);
    if (from && to) pairs.push_back({so3_log(from->conjugate() * *to) / (step.to - step.from), step.rate});
  }
  return pairs;
}

/// The offset [s] of the least residual among those `spacing` apart, up to `reach` to either side of
/// `middle`.
double best_offset(double middle, double reach, double spacing, const std::vector<Step>& steps,
                   const Turning& turning) {
  const auto tries = static_cast<int>(std::lround(reach / spacing));
  double best = middle;
  double least = HUGE_VAL;
  for (int i = -tries; i <= tries; ++i) {
    const double offset = std::clamp(middle + i * spacing, -kWidest, kWidest);
    const auto pairs = pairs_at(offset, steps, turning);
    if (pairs.size() != steps.size()) continue;
    const double residual = fit_rotation(pairs).residual;
    if (residual < least) {
      least = residual;
      best = offset;
    }
  }
  return best;
}

void drop_outliers(double offset, const Turning& turning, std::vector<Step>& steps) {
  const auto pairs = pairs_at(offset, steps, turning);
  const RotationFit fit = fit_rotation(pairs);
  std::vector<double> errors;
  for (const VectorPair& pair : pairs)
    errors.push_back((pair.to - fit.rotation * pair.from - fit.offset).norm());
  std::vector<double> sorted = errors;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<long>(sorted.size() / 2), sorted.end());
  const double most = kOutlier * sorted[sorted.size() / 2];
  size_t i = 0;
  std::erase_if(steps, [&](const Step&) { return errors[i++] > most; });
}

/// The bottom of the parabola through three tries, and how sharp it is.
void refine(double middle, const std::vector<Step>& steps, const Turning& turning, CameraAndGyro& result) {
  const auto residual = [&](double offset) {
    return fit_rotation(pairs_at(offset, steps, turning)).residual;
  };
  middle = std::clamp(middle, kFine - kWidest, kWidest - kFine);
  const double left = residual(middle - kFine);
  const double least = residual(middle);
  const double right = residual(middle + kFine);
  const double curvature = (left + right - 2 * least) / (kFine * kFine);
  const double shift = curvature > 0 ? (left - right) / (2 * kFine * curvature) : 0;
  result.offset = middle + std::clamp(shift, -kFine, kFine);
  const double variance = least / static_cast<double>(3 * steps.size());
  result.sigma = curvature > 0 ? std::sqrt(2 * variance / curvature) : kWidest;
}

double square_sum_about_mean(const std::vector<Step>& steps) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Step& step : steps) mean += step.rate / static_cast<double>(steps.size());
  double sum = 0;
  for (const Step& step : steps) sum += (step.rate - mean).squaredNorm();
  return sum;
}

}  // namespace

Result<CameraAndGyro> align_camera_and_gyro(std::span<const GyroSample> gyro,
                                            std::span<const CameraRotation> camera) {
  const auto too_few = [](size_t count) {
    return fail(
        ErrorCode::kRefused,
        fmt::format("{} images with a pose and the gyro's samples around them, of {} needed; go on for some "
                    "seconds while the camera is tracked",
                    count, kFewest));
  };
  if (gyro.size() < 2) return too_few(0);
  const Turning turning(gyro);
  std::vector<Step> steps = steps_of(camera, turning);
  if (steps.size() < kFewest) return too_few(steps.size());
  drop_outliers(best_offset(0, kWidest, kCoarse, steps, turning), turning, steps);
  const double total = square_sum_about_mean(steps);
  if (std::sqrt(total / static_cast<double>(steps.size())) < kLeastTurning)
    return fail(ErrorCode::kRefused, "the camera hardly turned; turn it to and fro about two axes");
  const double coarse = best_offset(0, kWidest, kCoarse, steps, turning);
  CameraAndGyro result;
  refine(best_offset(coarse, kCoarse, kFine, steps, turning), steps, turning, result);
  const RotationFit fit = fit_rotation(pairs_at(result.offset, steps, turning));
  result.correlation = 1 - fit.residual / total;
  result.residual = std::sqrt(fit.residual / static_cast<double>(steps.size()));
  if (result.correlation < kLeastCorrelation || kWidest - std::abs(result.offset) < kCoarse)
    return fail(ErrorCode::kConfiguration,
                fmt::format("gyro and camera do not turn alike within {} s; check that they are on one "
                            "mount and by one clock",
                            kWidest));
  result.camera_from_imu = fit.rotation;
  result.bias = -(fit.rotation.conjugate() * fit.offset);
  result.rotation_known = fit.about > kLeastTurning;
  return result;
}

void ClockOffset::sense(const GyroSample& sample) {
  if (!gyro_.empty() && sample.when <= gyro_.back().when) gyro_.clear();
  gyro_.push_back(sample);
  while (seconds_between(sample.when, gyro_.front().when) > kWindow) gyro_.pop_front();
}

void ClockOffset::see(const CameraRotation& rotation) {
  if (!camera_.empty() && rotation.when <= camera_.back().when) camera_.clear();
  camera_.push_back(rotation);
  while (seconds_between(rotation.when, camera_.front().when) > kWindow) camera_.pop_front();
}

Result<CameraAndGyro> ClockOffset::estimate() const {
  return align_camera_and_gyro(std::vector<GyroSample>(gyro_.begin(), gyro_.end()),
                               std::vector<CameraRotation>(camera_.begin(), camera_.end()));
}

}  // namespace cairn
