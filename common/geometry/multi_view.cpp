// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/multi_view.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "common/base/median.h"
#include "common/geometry/levenberg_marquardt.h"
#include "common/geometry/robust.h"
#include "common/geometry/two_view.h"

namespace cairn {
namespace {

constexpr int kIterations = 30;
/// [px] Residuals below are taken for chance: what rounding to whole grey values leaves of a patch. Not a
/// guess of the noise, which the residuals say: trails of a sharp image are good to 0.04 px.
constexpr double kLeastNoise = 0.01;
/// The best motion is clear when the second costs this many times as much. The noise of trails differs by ten
/// between sharp and compressed images, so the residuals themselves say how large it is; what calibration
/// leaves unexplained is in both, and so is what neither explains.
constexpr double kClearRatio = 1.1;

/// Share of the cost: a step that gains less is the last.
constexpr double kLeastGain = 1e-4;

/// Least squared sine of the angle between a point's ray and the motion, whose length is 1. A point that is
/// seen along the motion begins at infinity: the two views do not tell its depth.
constexpr double kAlongMotion = 1e-12;
/// Relative standard deviation of the focal length of a camera that counts as known. The image's height and
/// shear are as uncertain: a turn of 30 degrees/s, read row by row for a 30th of a second, changes them by as
/// much.
constexpr double kCommonSigma = 0.0125;
/// Least ratio of the smallest pivot to the largest: below, the views do not determine their poses.
constexpr double kSingular = 1e-12;

/// Poses of the further views in the first, and each point's inverse distance along its first ray.
struct Structure {
  std::vector<SE3> view_from_first;
  Eigen::VectorXd inverse_distance;  ///< >= 0, in units of 1 / |last translation|
};

struct Problem {
  const Camera& camera;
  const MultiView& views;
  std::vector<Eigen::Vector3d> rays;  ///< unit, of the first view
  Eigen::Vector2d center;             ///< [px] where the optical axis is seen

  [[nodiscard]] size_t points() const { return rays.size(); }
  [[nodiscard]] size_t poses() const { return views.further.size(); }
};

/// Squared residuals [px^2], view by view; infinite where a point does not project.
std::vector<double> squared_residuals(const Problem& problem, const Structure& s) {
  std::vector<double> squared;
  squared.reserve(problem.points() * problem.poses());
  for (size_t v = 0; v < problem.poses(); ++v) {
    const Eigen::Matrix3d rotation = s.view_from_first[v].rotation_matrix();
    const Eigen::Vector3d& t = s.view_from_first[v].translation();
    for (size_t i = 0; i < problem.points(); ++i) {
      const Eigen::Vector3d p =
          rotation * problem.rays[i] + s.inverse_distance[static_cast<Eigen::Index>(i)] * t;
      const auto pixel = problem.camera.project(p);
      squared.push_back(pixel ? (*pixel - problem.views.further[v].pixels[i]).squaredNorm()
                              : std::numeric_limits<double>::infinity());
    }
  }
  return squared;
}

double robust_cost(const std::vector<double>& squared, double squared_cutoff) {
  double sum = 0;
  for (const double s : squared) sum += tukey_cost(s, squared_cutoff);
  return sum;
}

/// The squared cut-off of the view which fits worst: one for all views would let the others leave it out.
double cutoff_of(std::vector<double> squared, size_t points) {
  double cutoff = std::pow(kTukeyCutoffPerSigma * kLeastNoise, 2);
  for (size_t at = 0; at < squared.size(); at += points) {
    const double of_view = tukey_squared_cutoff(std::span(squared).subspan(at, points));
    if (std::isfinite(of_view)) cutoff = std::max(cutoff, of_view);
  }
  return cutoff;
}

/// A point in a further view, linearized.
struct Sighting {
  double weight = 0;
  Eigen::Vector2d residual;             ///< [px]
  Eigen::Matrix<double, 2, 6> by_pose;  ///< left tangent (translation, rotation)
  Eigen::Vector2d by_point;             ///< by inverse distance
};

/// `rotation` is that of view v. Weight 0 for an outlier and where the point does not project.
Sighting linearize(const Problem& problem, const Structure& s, size_t v, const Eigen::Matrix3d& rotation,
                   size_t i, double squared_cutoff) {
  const double inverse_distance = s.inverse_distance[static_cast<Eigen::Index>(i)];
  const Eigen::Vector3d& t = s.view_from_first[v].translation();
  const Eigen::Vector3d p = rotation * problem.rays[i] + inverse_distance * t;
  Sighting o;
  Matrix23d by_p;
  const auto pixel = problem.camera.project(p, &by_p);
  if (!pixel) return o;
  o.residual = *pixel - problem.views.further[v].pixels[i];
  o.weight = tukey_weight(o.residual.squaredNorm(), squared_cutoff);
  o.by_pose.leftCols<3>() = inverse_distance * by_p;
  for (int row = 0; row < 2; ++row)
    o.by_pose.row(row).tail<3>() = p.cross(by_p.row(row).transpose()).transpose();
  o.by_point = by_p * t;
  return o;
}

/// Normal equations of all poses and points; a point has one value, so its block is a number.
struct NormalEquations {
  Eigen::MatrixXd poses;
  Eigen::VectorXd pose_gradient;
  Eigen::MatrixXd pose_by_point;
  Eigen::VectorXd points;
  Eigen::VectorXd point_gradient;
};

NormalEquations build(const Problem& problem, const Structure& s, double squared_cutoff) {
  const auto n = static_cast<Eigen::Index>(problem.points());
  const auto size = static_cast<Eigen::Index>(6 * problem.poses());
  NormalEquations e{Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size),
                    Eigen::MatrixXd::Zero(size, n), Eigen::VectorXd::Zero(n), Eigen::VectorXd::Zero(n)};
  for (size_t v = 0; v < problem.poses(); ++v) {
    const Eigen::Matrix3d rotation = s.view_from_first[v].rotation_matrix();
    const auto at = static_cast<Eigen::Index>(6 * v);
    for (Eigen::Index i = 0; i < n; ++i) {
      const Sighting o = linearize(problem, s, v, rotation, static_cast<size_t>(i), squared_cutoff);
      if (o.weight == 0) continue;
      e.poses.block<6, 6>(at, at).noalias() += o.weight * o.by_pose.transpose() * o.by_pose;
      e.pose_gradient.segment<6>(at).noalias() += o.weight * o.by_pose.transpose() * o.residual;
      e.pose_by_point.block<6, 1>(at, i).noalias() = o.weight * o.by_pose.transpose() * o.by_point;
      e.points[i] += o.weight * o.by_point.squaredNorm();
      e.point_gradient[i] += o.weight * o.by_point.dot(o.residual);
    }
  }
  return e;
}

/// The equations of the poses once the points are eliminated (Schur complement), and what gives their steps
/// back.
struct Reduced {
  Eigen::MatrixXd information;
  Eigen::VectorXd gradient;
  Eigen::MatrixXd pose_by_point;  ///< divided by the point's information
  Eigen::VectorXd point_steps;    ///< if the poses stood still
};

Reduced reduce(const NormalEquations& e, const Structure& s, double damping) {
  Reduced r{e.poses, e.pose_gradient, e.pose_by_point, Eigen::VectorXd::Zero(e.points.size())};
  r.information.diagonal() *= 1 + damping;
  for (Eigen::Index i = 0; i < e.points.size(); ++i) {
    const bool would_go_behind = s.inverse_distance[i] == 0 && e.point_gradient[i] > 0;
    if (would_go_behind || !(e.points[i] > 0)) {
      r.pose_by_point.col(i).setZero();
      continue;
    }
    const double information = e.points[i] * (1 + damping);
    r.point_steps[i] = e.point_gradient[i] / information;
    r.gradient.noalias() -= e.pose_by_point.col(i) * r.point_steps[i];
    r.pose_by_point.col(i) /= information;
  }
  r.information.noalias() -= r.pose_by_point * e.pose_by_point.transpose();
  // The scale is free: the last baseline keeps its length.
  const Eigen::Index last = r.information.rows() - 6;
  const Eigen::Vector3d along = s.view_from_first.back().translation().normalized();
  r.information.block<3, 3>(last, last) += r.information.trace() * along * along.transpose();
  return r;
}

Structure moved(const Structure& s, const Reduced& r, const Eigen::VectorXd& step) {
  Structure next = s;
  for (size_t v = 0; v < s.view_from_first.size(); ++v)
    next.view_from_first[v] =
        SE3::exp(step.segment<6>(static_cast<Eigen::Index>(6 * v))) * s.view_from_first[v];
  next.inverse_distance =
      (s.inverse_distance - r.point_steps - r.pose_by_point.transpose() * step).cwiseMax(0.0);
  return next;
}

/// A structure with the squared residual that it leaves of each point in each view.
struct Judged {
  Structure structure;
  std::vector<double> squared;
};

/// The cut-off follows the residuals unless it is given. Returns the last cut-off.
double adjust(const Problem& problem, std::optional<double> given_cutoff, Structure* s) {
  Judged judged{*s, squared_residuals(problem, *s)};
  double cutoff = 0;
  LevenbergMarquardtOptions options;
  options.iterations = kIterations;
  options.least_gain = kLeastGain;
  const auto linearize = [&](const Judged& at) {
    cutoff = given_cutoff ? *given_cutoff : cutoff_of(at.squared, problem.points());
    return build(problem, at.structure, cutoff);
  };
  const auto step = [&](const Judged& from, const NormalEquations& equations,
                        double damping) -> std::optional<Judged> {
    const Reduced r = reduce(equations, from.structure, damping);
    const Eigen::VectorXd by = -r.information.ldlt().solve(r.gradient);
    if (!by.allFinite()) return std::nullopt;
    Structure next = moved(from.structure, r, by);
    std::vector<double> squared = squared_residuals(problem, next);
    return Judged{std::move(next), std::move(squared)};
  };
  levenberg_marquardt(options, &judged, linearize, step,
                      [&](const Judged& at) { return robust_cost(at.squared, cutoff); });
  *s = std::move(judged.structure);
  return cutoff;
}

/// Inverse distances that explain the last view best, for poses of the views as far on the way as they are.
Structure begin_with(const Problem& problem, const SE3& motion) {
  Structure s;
  const Vector6d whole = motion.log();
  for (const FurtherView& view : problem.views.further)
    s.view_from_first.push_back(view.baseline_fraction < 1 ? SE3::exp(view.baseline_fraction * whole)
                                                           : motion);
  const Eigen::Matrix3d rotation = motion.rotation_matrix();
  s.inverse_distance = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(problem.points()));
  for (size_t i = 0; i < problem.points(); ++i) {
    // b ~ R a + rho t: both sides crossed with b.
    const Eigen::Vector3d b = problem.camera.unproject(problem.views.further.back().pixels[i]);
    const Eigen::Vector3d from_turn = b.cross(rotation * problem.rays[i]);
    const Eigen::Vector3d from_shift = b.cross(motion.translation());
    const double scale = from_shift.squaredNorm();
    if (!(scale > kAlongMotion)) continue;
    const double inverse_distance = std::max(0.0, -from_turn.dot(from_shift) / scale);
    const bool in_front = b.dot(rotation * problem.rays[i] + inverse_distance * motion.translation()) > 0;
    if (in_front) s.inverse_distance[static_cast<Eigen::Index>(i)] = inverse_distance;
  }
  return s;
}

using CommonErrors = Matrix23d;  ///< by column: focal length, height, shear

/// How uncertain an adjusted motion and its points are.
struct Uncertainty {
  double direction = std::numeric_limits<double>::infinity();  ///< as in AdjustedMotion
  double depth = std::numeric_limits<double>::infinity();
};

/// [px^2] Of one coordinate of a residual.
double noise_variance(const Problem& problem, const std::vector<double>& squared, double squared_cutoff) {
  double sum = 0;
  double weights = 0;
  for (const double q : squared) {
    const double w = tukey_weight(q, squared_cutoff);
    if (w == 0) continue;
    sum += w * q;
    weights += 2 * w;
  }
  const double freedom = weights - static_cast<double>(problem.points() + 6 * problem.poses());
  if (!(freedom > 0)) return std::numeric_limits<double>::infinity();
  return std::max(sum / freedom, kLeastNoise * kLeastNoise);
}

/// [px] What may be wrong with all pixels alike, by one sigma each: a calibration's focal length, and what a
/// shutter that reads row by row makes of a turn, which lengthens or shears the image.
CommonErrors common_errors(const Problem& problem, const Eigen::Vector2d& pixel) {
  const Eigen::Vector2d from_center = kCommonSigma * (pixel - problem.center);
  CommonErrors errors;
  errors << from_center.x(), 0, from_center.y(),  //
      from_center.y(), from_center.y(), 0;
  return errors;
}

/// [px] What they add to the residual `o` of point i in view v.
CommonErrors added_to_residual(const Problem& problem, const Structure& s, size_t v, size_t i,
                               const Sighting& o) {
  const FurtherView& view = problem.views.further[v];
  const CommonErrors here = common_errors(problem, problem.views.first[i]);
  CommonErrors added = -common_errors(problem, view.pixels[i]);
  for (Eigen::Index c = 0; c < added.cols(); ++c) {
    const Eigen::Vector3d ray = problem.camera.unproject(problem.views.first[i] + here.col(c));
    const SE3& pose = s.view_from_first[v];
    const auto pixel = problem.camera.project(
        pose.rotation() * ray + s.inverse_distance[static_cast<Eigen::Index>(i)] * pose.translation());
    if (pixel) added.col(c) += *pixel - view.pixels[i] - o.residual;
  }
  return added;
}

/// How far each of the common errors moves each point's inverse distance, as a share of it, when nobody
/// allows for the error. A row for each point, a column for each error.
Eigen::MatrixXd spoilt_by_common_errors(const Problem& problem, const Structure& s, NormalEquations equations,
                                        const Eigen::LDLT<Eigen::MatrixXd>& factors, double squared_cutoff) {
  const auto n = static_cast<Eigen::Index>(problem.points());
  Eigen::MatrixXd by_poses = Eigen::MatrixXd::Zero(equations.poses.rows(), CommonErrors::ColsAtCompileTime);
  Eigen::MatrixXd by_points = Eigen::MatrixXd::Zero(n, CommonErrors::ColsAtCompileTime);
  for (size_t v = 0; v < problem.poses(); ++v) {
    const Eigen::Matrix3d rotation = s.view_from_first[v].rotation_matrix();
    for (Eigen::Index i = 0; i < n; ++i) {
      const Sighting o = linearize(problem, s, v, rotation, static_cast<size_t>(i), squared_cutoff);
      if (o.weight == 0) continue;
      const CommonErrors added = added_to_residual(problem, s, v, static_cast<size_t>(i), o);
      by_poses.middleRows<6>(static_cast<Eigen::Index>(6 * v)) += o.weight * o.by_pose.transpose() * added;
      by_points.row(i) += o.weight * o.by_point.transpose() * added;
    }
  }
  Eigen::MatrixXd spoilt(n, by_points.cols());
  for (Eigen::Index c = 0; c < spoilt.cols(); ++c) {
    equations.pose_gradient = by_poses.col(c);
    equations.point_gradient = by_points.col(c);
    const Reduced r = reduce(equations, s, 0);
    const Eigen::VectorXd step = -factors.solve(r.gradient);
    spoilt.col(c) = (r.point_steps + r.pose_by_point.transpose() * step).cwiseQuotient(s.inverse_distance);
  }
  return spoilt;
}

Uncertainty uncertainty_of(const Problem& problem, const Structure& s, const std::vector<double>& squared,
                           double squared_cutoff) {
  const double variance = noise_variance(problem, squared, squared_cutoff);
  const NormalEquations equations = build(problem, s, squared_cutoff);
  const Reduced r = reduce(equations, s, 0);
  const Eigen::LDLT<Eigen::MatrixXd> factors(r.information);
  const auto pivots = factors.vectorD();
  if (!std::isfinite(variance) || !(pivots.minCoeff() > kSingular * pivots.maxCoeff())) return {};
  const Eigen::Index size = r.information.rows();
  const Eigen::MatrixXd covariance = factors.solve(Eigen::MatrixXd::Identity(size, size));
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> spectrum(covariance.block<3, 3>(size - 6, size - 6));
  const Eigen::MatrixXd spoilt = spoilt_by_common_errors(problem, s, equations, factors, squared_cutoff);
  std::vector<double> of_depths;
  for (Eigen::Index i = 0; i < equations.points.size(); ++i) {
    const auto by_poses = r.pose_by_point.col(i);
    const double of_point = by_poses.isZero(0)
                                ? std::numeric_limits<double>::infinity()
                                : 1 / equations.points[i] + by_poses.dot(covariance * by_poses);
    of_depths.push_back(
        std::hypot(std::sqrt(variance * of_point) / s.inverse_distance[i], spoilt.row(i).norm()));
  }
  return {
      std::sqrt(variance * spectrum.eigenvalues()(2)) / s.view_from_first.back().translation().norm(),
      of_depths.empty() ? std::numeric_limits<double>::infinity() : reorder_to_median(std::span(of_depths))};
}

}  // namespace

MotionsAdjusted adjust_motions(const Camera& camera, const MultiView& views,
                               std::span<const SE3> last_from_first) {
  const auto center = camera.project(Eigen::Vector3d::UnitZ());
  Problem problem{camera, views, {}, center.value_or(Eigen::Vector2d::Zero())};
  for (const Eigen::Vector2d& pixel : views.first) problem.rays.push_back(camera.unproject(pixel));
  std::vector<Structure> structures;
  double cutoff = std::numeric_limits<double>::infinity();
  for (const SE3& motion : last_from_first) {
    structures.push_back(begin_with(problem, motion));
    cutoff = std::min(cutoff, adjust(problem, std::nullopt, &structures.back()));
  }
  MotionsAdjusted result;
  for (Structure& s : structures) {
    (void)adjust(problem, cutoff, &s);
    const std::vector<double> squared = squared_residuals(problem, s);
    const SE3& last = s.view_from_first.back();
    const Uncertainty uncertainty = uncertainty_of(problem, s, squared, cutoff);
    result.motions.push_back({SE3(last.rotation(), last.translation().normalized()),
                              robust_cost(squared, cutoff), uncertainty.direction, uncertainty.depth});
  }
  result.noise_cost = kLeastNoise * kLeastNoise * static_cast<double>(problem.points() * problem.poses());
  return result;
}

const AdjustedMotion* clear_best(const MotionsAdjusted& adjusted) {
  const auto& motions = adjusted.motions;
  const auto best = std::min_element(motions.begin(), motions.end(),
                                     [](const auto& a, const auto& b) { return a.cost < b.cost; });
  if (best == motions.end()) return nullptr;
  const double limit = kClearRatio * std::max(best->cost, adjusted.noise_cost);
  const bool has_rival = std::any_of(motions.begin(), motions.end(), [&](const AdjustedMotion& m) {
    return m.cost < limit && !same_motion(m.last_from_first, best->last_from_first);
  });
  return has_rival ? nullptr : &*best;
}

}  // namespace cairn
