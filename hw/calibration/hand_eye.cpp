// SPDX-License-Identifier: Apache-2.0
#include "hw/calibration/hand_eye.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include "common/geometry/least_squares.h"
#include "common/geometry/levenberg_marquardt.h"
#include "common/geometry/ransac.h"
#include "common/geometry/se3.h"

namespace cairn {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Matrix36d = Eigen::Matrix<double, 3, 6>;

constexpr size_t kFewest = 8;
constexpr double kLeastRange = 10 * std::numbers::pi / 180;
constexpr int kSteps = 30;
constexpr int kRounds = 3;            // of leaving out what does not fit
constexpr double kOutlier = 4;        // times the median
constexpr double kLeastError = 1e-4;  // [rad]: nothing that fits so well is left out
constexpr double kLeastShare = 2.0 / 3;
constexpr double kMostResidual = 2 * std::numbers::pi / 180;  // no gear and no tracker is so bad
constexpr double kLeastGain = 1e-12;  // share of the cost; a step that gains less is the last

/// The rotation map_from_camera at a glance, as `found` expects it.
Quaterniond expected(const HandEye& found, const Glance& glance) {
  return found.map_from_base * base_from_head(glance.angles) * found.head_from_camera;
}

Vector3d rotation_error(const HandEye& found, const Glance& glance) {
  return so3_log(expected(found, glance).conjugate() * glance.map_from_camera);
}

enum class Loss {
  kNorm,     ///< of least errors, to which some that are far off do not matter
  kSquares,  ///< of least squares
};

/// Half of the square of `error`, or its norm, whose tip is a parabola (Huber) below kLeastError.
double loss(Loss kind, double error) {
  if (kind == Loss::kSquares) return error * error / 2;
  return error < kLeastError ? error * error / (2 * kLeastError) : error - kLeastError / 2;
}

/// Derivative of loss() by the error, over the error: the weight of its square.
double weight(Loss kind, double error) {
  return kind == Loss::kSquares ? 1 : 1 / std::max(kLeastError, error);
}

/// Fits both rotations to the glances.
void fit_rotations(const std::vector<Glance>& glances, Loss kind, HandEye& found) {
  const auto linearize = [&](const HandEye& now) {
    LeastSquares<6> equations;  // in a turn of the base, and of the camera, each in its own axes
    for (const Glance& glance : glances) {
      Matrix36d jacobian;
      jacobian.leftCols<3>() =
          -(base_from_head(glance.angles) * now.head_from_camera).conjugate().toRotationMatrix();
      jacobian.rightCols<3>() = -Matrix3d::Identity();
      const Vector3d error = rotation_error(now, glance);
      equations.add(jacobian, error, weight(kind, error.norm()));
    }
    return equations;
  };
  const auto step = [](const HandEye& now, const LeastSquares<6>& equations,
                       double damping) -> std::optional<HandEye> {
    const auto change = equations.step(damping);
    if (!change) return std::nullopt;
    HandEye next = now;
    next.map_from_base = (now.map_from_base * so3_exp(change->head<3>())).normalized();
    next.head_from_camera = (now.head_from_camera * so3_exp(change->tail<3>())).normalized();
    return next;
  };
  const auto cost = [&](const HandEye& now) {
    double sum = 0;
    for (const Glance& glance : glances) sum += loss(kind, rotation_error(now, glance).norm());
    return sum;
  };
  levenberg_marquardt({.iterations = kSteps, .least_gain = kLeastGain}, &found, linearize, step, cost);
}

/// Linear: the camera's centre is at base_in_map + map_from_head * camera_in_head. False if it has no
/// solution.
bool fit_positions(const std::vector<Glance>& glances, HandEye& found) {
  found.base_in_map = found.camera_in_head = Vector3d::Zero();
  const auto error_of = [&](const Glance& glance) -> Vector3d {
    const Quaterniond map_from_head = found.map_from_base * base_from_head(glance.angles);
    return found.base_in_map + map_from_head * found.camera_in_head - glance.camera_in_map;
  };
  LeastSquares<6> equations;
  for (const Glance& glance : glances) {
    Matrix36d jacobian;
    jacobian.leftCols<3>() = Matrix3d::Identity();
    jacobian.rightCols<3>() = (found.map_from_base * base_from_head(glance.angles)).toRotationMatrix();
    equations.add(jacobian, error_of(glance));
  }
  const auto solution = equations.step();
  if (!solution) return false;
  found.base_in_map = solution->head<3>();
  found.camera_in_head = solution->tail<3>();
  double sum = 0;
  for (const Glance& glance : glances) sum += error_of(glance).squaredNorm();
  found.position_residual = std::sqrt(sum / static_cast<double>(glances.size()));
  return true;
}

/// The glances of `all` that fit.
std::vector<Glance> fitting(std::span<const Glance> all, const HandEye& found) {
  std::vector<double> errors;
  for (const Glance& glance : all) errors.push_back(rotation_error(found, glance).norm());
  std::vector<double> sorted = errors;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<long>(sorted.size() / 2), sorted.end());
  const double most = kOutlier * std::max(kLeastError, sorted[sorted.size() / 2]);
  std::vector<Glance> fit;
  for (size_t i = 0; i < all.size(); ++i) {
    if (errors[i] <= most) fit.push_back(all[i]);
  }
  return fit;
}

/// The base as most glances have it if the camera sits as it should.
HandEye begin(std::span<const Glance> glances) {
  HandEye found;
  found.head_from_camera = nominal_head_from_camera();
  double least = HUGE_VAL;
  for (const Glance& from : glances) {
    HandEye tried = found;
    tried.map_from_base =
        from.map_from_camera * (base_from_head(from.angles) * found.head_from_camera).conjugate();
    // Not of squares: some may be far off.
    const double cost = truncated_cost(
        glances, HUGE_VAL, least, [&](const Glance& glance) { return rotation_error(tried, glance).norm(); });
    if (cost < least) {
      least = cost;
      found = tried;
    }
  }
  return found;
}

double range(std::span<const Glance> glances, double PanTilt::*angle) {
  const auto [low, high] = std::minmax_element(
      glances.begin(), glances.end(),
      [angle](const Glance& a, const Glance& b) { return a.angles.*angle < b.angles.*angle; });
  return high->angles.*angle - low->angles.*angle;
}

}  // namespace

Result<HandEye> calibrate_hand_eye(std::span<const Glance> glances) {
  if (glances.size() < kFewest)
    return fail(ErrorCode::kRefused, fmt::format("{} glances of {} needed; look at more places of the map",
                                                 glances.size(), kFewest));
  for (const auto& [name, angle] : {std::pair{"pan", &PanTilt::pan}, {"tilt", &PanTilt::tilt}}) {
    if (range(glances, angle) < kLeastRange)
      return fail(
          ErrorCode::kRefused,
          fmt::format("the glances hardly differ in {}; look at places at least 10 degrees apart", name));
  }
  HandEye found = begin(glances);
  std::vector<Glance> used(glances.begin(), glances.end());
  for (int round = 0; round <= kRounds; ++round) {
    fit_rotations(used, round > 0 ? Loss::kSquares : Loss::kNorm, found);
    if (round < kRounds) used = fitting(glances, found);
  }
  double sum = 0;
  for (const Glance& glance : used) sum += rotation_error(found, glance).squaredNorm();
  found.used = used.size();
  found.rotation_residual = std::sqrt(sum / static_cast<double>(used.size()));
  if (static_cast<double>(used.size()) < kLeastShare * static_cast<double>(glances.size()) ||
      found.rotation_residual > kMostResidual)
    return fail(
        ErrorCode::kRefused,
        fmt::format(
            "{} of {} glances fit each other, within {:.1f} degrees; let the base stand still and the "
            "map be tracked",
            used.size(), glances.size(), found.rotation_residual * 180 / std::numbers::pi));
  if (!fit_positions(used, found))
    return fail(ErrorCode::kRefused,
                "the glances do not tell where the camera sits on the head; look at more places of the map");
  return found;
}

}  // namespace cairn
