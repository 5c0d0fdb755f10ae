// SPDX-License-Identifier: Apache-2.0
#include "client/app/calibrate/solver.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "client/app/calibrate/board_pose.h"
#include "common/geometry/levenberg_marquardt.h"

namespace cairn {
namespace {

constexpr size_t kMinViews = 3;
constexpr size_t kMinPoints = 6;  ///< of a view
constexpr Eigen::Index kLinearAndFirstDistortion = 5;
constexpr Eigen::Index kAllValues = 8;  ///< of both models: four linear ones and four of distortion
constexpr double kInfinity = std::numeric_limits<double>::infinity();

using Matrix26d = Eigen::Matrix<double, 2, 6>;

/// A camera and the poses of all views; a view without a pose does not count.
struct State {
  CameraPtr camera;
  std::vector<std::optional<SE3>> poses;
};

/// Normal equations with the poses apart: [A B; B^T C], C block-diagonal.
struct NormalEquations {
  Eigen::MatrixXd camera;              ///< A
  Eigen::VectorXd camera_gradient;     ///< J^T r
  std::vector<Eigen::MatrixXd> mixed;  ///< B, by view
  std::vector<Matrix6d> pose;          ///< C, by view
  std::vector<Vector6d> pose_gradient;
};

class Problem {
 public:
  Problem(CameraModel model, ImageSize size, const std::vector<BoardView>& views)
      : model_(model), size_(size), views_(views) {
    for (const auto& view : views) inliers_.emplace_back(view.size(), true);
  }

  /// The focal length whose poses, from homographies alone, leave the smallest median error.
  [[nodiscard]] std::optional<State> guess() const {
    std::optional<State> best;
    double best_error = kInfinity;
    for (double focal = 0.25 * size_.width; focal < 4.0 * size_.width; focal *= 1.15) {
      State state{camera_of({focal, focal, 0.5 * (size_.width - 1), 0.5 * (size_.height - 1), 0, 0, 0, 0}),
                  {}};
      std::vector<double> errors;
      for (const auto& view : views_) {
        state.poses.push_back(board_pose(*state.camera, view));
        if (!state.poses.back()) continue;
        for (size_t i = 0; i < view.size(); ++i) {
          const auto pixel = state.camera->project(*state.poses.back() * view.on_board[i]);
          errors.push_back(pixel ? (*pixel - view.pixels[i]).squaredNorm() : kInfinity);
        }
      }
      if (errors.empty()) continue;
      const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
      std::nth_element(errors.begin(), middle, errors.end());
      if (*middle >= best_error) continue;
      best_error = *middle;
      best = std::move(state);
    }
    return best;
  }

  /// Views whose points do not all project as the state stands cannot be improved on: they leave.
  void drop_hopeless(State* state) const {
    for (size_t v = 0; v < views_.size(); ++v) {
      if (state->poses[v] && !std::isfinite(view_cost(*state, v))) state->poses[v].reset();
    }
  }

  /// Levenberg-Marquardt over the poses and the camera's first `free` values.
  void minimize(Eigen::Index free, State* state) const {
    LevenbergMarquardtOptions options;
    options.iterations = 100;
    options.attempts = 100;
    options.first_damping = 1e-3;
    options.after_refused = 10;
    options.least_damping = 1e-12;
    options.most_damping = 1e10;
    options.least_gain = 1e-10;
    levenberg_marquardt(
        options, state, [&](const State& at) { return linearize(at, free); },
        [&](const State& from, const NormalEquations& equations, double damping) {
          return step(from, equations, free, damping);
        },
        [&](const State& at) { return cost(at); });
  }

  /// Leaves out points far beyond the others and views that are off as a whole or have too little left.
  void reject_outliers(State* state) {
    std::vector<double> distances;
    for_each_residual(*state,
                      [&](size_t, size_t, const Eigen::Vector2d& r) { distances.push_back(r.norm()); });
    if (distances.empty()) return;
    const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
    std::nth_element(distances.begin(), middle, distances.end());
    constexpr double kRayleighMedian = 1.1774;  // of the distance, in sigmas of a coordinate
    constexpr double kSmallest = 0.05;          // [px]: what perfect images leave is no outlier
    const double limit = std::max(kSmallest, 4.5 * *middle / kRayleighMedian);
    std::vector<size_t> left(views_.size(), 0);
    for_each_residual(*state, [&](size_t v, size_t i, const Eigen::Vector2d& r) {
      if (r.norm() > limit) {
        inliers_[v][i] = false;
      } else {
        ++left[v];
      }
    });
    for (size_t v = 0; v < views_.size(); ++v) {
      if (left[v] < std::max(kMinPoints, views_[v].size() / 2)) state->poses[v].reset();
    }
  }

  [[nodiscard]] Result<BoardCalibration> report(const State& state, Eigen::Index free) const {
    BoardCalibration result;
    result.parameters = state.camera->parameters();
    result.views.resize(views_.size());
    double sum = 0;
    size_t count = 0;
    size_t poses = 0;
    for (size_t v = 0; v < views_.size(); ++v) {
      SolvedView& solved = result.views[v];
      solved.inliers.assign(views_[v].size(), false);
      if (!state.poses[v]) continue;
      ++poses;
      solved.camera_from_board = *state.poses[v];
      solved.inliers = inliers_[v];
      const auto points = static_cast<size_t>(std::count(inliers_[v].begin(), inliers_[v].end(), true));
      const double squares = view_cost(state, v);
      solved.rms = std::sqrt(squares / static_cast<double>(points));
      sum += squares;
      count += points;
    }
    if (poses < kMinViews) {
      return fail(ErrorCode::kDegenerate, "only " + std::to_string(poses) +
                                              " views of the board agree with each other, 3 are the least");
    }
    result.rms = std::sqrt(sum / static_cast<double>(count));
    const double freedom =
        2.0 * static_cast<double>(count) - static_cast<double>(free) - 6.0 * static_cast<double>(poses);
    const Eigen::LDLT<Eigen::MatrixXd> reduced(reduced_camera(linearize(state, free), 0).first);
    const Eigen::MatrixXd inverse = reduced.solve(Eigen::MatrixXd::Identity(free, free));
    const Eigen::VectorXd variance = inverse.diagonal() * (sum / freedom);
    if (!(freedom > 0) || reduced.info() != Eigen::Success || !variance.allFinite() ||
        !(variance.minCoeff() >= 0)) {
      return fail(ErrorCode::kDegenerate,
                  "the views do not determine the camera: tilt the board in different ways");
    }
    for (Eigen::Index i = 0; i < free; ++i) result.sigma.push_back(std::sqrt(variance(i)));
    return result;
  }

 private:
  [[nodiscard]] CameraPtr camera_of(std::vector<double> values) const {
    const auto camera = make_camera({model_, size_.width, size_.height, std::move(values)});
    return camera ? *camera : nullptr;
  }

  template <typename F>
  void for_each_residual(const State& state, F f) const {
    for (size_t v = 0; v < views_.size(); ++v) {
      if (!state.poses[v]) continue;
      for (size_t i = 0; i < views_[v].size(); ++i) {
        if (!inliers_[v][i]) continue;
        const auto pixel = state.camera->project(*state.poses[v] * views_[v].on_board[i]);
        f(v, i, pixel ? Eigen::Vector2d(*pixel - views_[v].pixels[i]) : Eigen::Vector2d::Constant(kInfinity));
      }
    }
  }

  [[nodiscard]] double view_cost(const State& state, size_t v) const {
    double sum = 0;
    for (size_t i = 0; i < views_[v].size(); ++i) {
      if (!inliers_[v][i]) continue;
      const auto pixel = state.camera->project(*state.poses[v] * views_[v].on_board[i]);
      if (!pixel) return kInfinity;
      sum += (*pixel - views_[v].pixels[i]).squaredNorm();
    }
    return sum;
  }

  [[nodiscard]] double cost(const State& state) const {
    double sum = 0;
    for (size_t v = 0; v < views_.size(); ++v) sum += state.poses[v] ? view_cost(state, v) : 0;
    return sum;
  }

  [[nodiscard]] NormalEquations linearize(const State& state, Eigen::Index free) const {
    NormalEquations n;
    n.camera = Eigen::MatrixXd::Zero(free, free);
    n.camera_gradient = Eigen::VectorXd::Zero(free);
    n.mixed.assign(views_.size(), Eigen::MatrixXd::Zero(free, 6));
    n.pose.assign(views_.size(), Matrix6d::Zero());
    n.pose_gradient.assign(views_.size(), Vector6d::Zero());
    for (size_t v = 0; v < views_.size(); ++v) {
      if (!state.poses[v]) continue;
      for (size_t i = 0; i < views_[v].size(); ++i) {
        if (!inliers_[v][i]) continue;
        const Eigen::Vector3d point = *state.poses[v] * views_[v].on_board[i];
        Matrix23d by_point;
        const auto pixel = state.camera->project(point, &by_point);
        if (!pixel) continue;
        const Eigen::Vector2d r = *pixel - views_[v].pixels[i];
        const Matrix26d by_pose = by_point * d_transformed_d_xi(point);
        const Eigen::Matrix2Xd by_camera = state.camera->d_pixel_d_parameters(point).leftCols(free);
        n.camera.noalias() += by_camera.transpose() * by_camera;
        n.camera_gradient.noalias() += by_camera.transpose() * r;
        n.mixed[v].noalias() += by_camera.transpose() * by_pose;
        n.pose[v].noalias() += by_pose.transpose() * by_pose;
        n.pose_gradient[v].noalias() += by_pose.transpose() * r;
      }
    }
    return n;
  }

  /// The camera's equations after the poses are eliminated: matrix and right-hand side.
  [[nodiscard]] std::pair<Eigen::MatrixXd, Eigen::VectorXd> reduced_camera(const NormalEquations& n,
                                                                           double damping) const {
    Eigen::MatrixXd matrix = n.camera;
    matrix.diagonal() *= 1 + damping;
    Eigen::VectorXd right = -n.camera_gradient;
    for (size_t v = 0; v < views_.size(); ++v) {
      if (n.pose[v].isZero(0)) continue;
      const Eigen::LDLT<Matrix6d> pose(damped(n.pose[v], damping));
      matrix.noalias() -= n.mixed[v] * pose.solve(n.mixed[v].transpose());
      right.noalias() += n.mixed[v] * pose.solve(n.pose_gradient[v]);
    }
    return {std::move(matrix), std::move(right)};
  }

  static Matrix6d damped(Matrix6d matrix, double damping) {
    matrix.diagonal() *= 1 + damping;
    return matrix;
  }

  [[nodiscard]] std::optional<State> step(const State& state, const NormalEquations& n, Eigen::Index free,
                                          double damping) const {
    const auto [matrix, right] = reduced_camera(n, damping);
    const Eigen::VectorXd camera_step = matrix.ldlt().solve(right);
    if (!camera_step.allFinite()) return std::nullopt;
    auto values = state.camera->parameters().values;
    for (Eigen::Index i = 0; i < free; ++i) values[static_cast<size_t>(i)] += camera_step(i);
    State next{camera_of(std::move(values)), state.poses};
    if (!next.camera) return std::nullopt;
    for (size_t v = 0; v < views_.size(); ++v) {
      if (!next.poses[v]) continue;
      const Vector6d right_pose = -n.pose_gradient[v] - n.mixed[v].transpose() * camera_step;
      const Vector6d xi = damped(n.pose[v], damping).ldlt().solve(right_pose);
      if (!xi.allFinite()) return std::nullopt;
      next.poses[v] = SE3::exp(xi) * *next.poses[v];
    }
    return next;
  }

  CameraModel model_;
  ImageSize size_;
  const std::vector<BoardView>& views_;
  std::vector<std::vector<bool>> inliers_;
};

}  // namespace

Result<BoardCalibration> calibrate(CameraModel model, ImageSize size, const std::vector<BoardView>& views) {
  if (model != CameraModel::kPinholeRadtan && model != CameraModel::kKannalaBrandt) {
    return fail(ErrorCode::kUsage, "calibrates pinhole-radtan and kb4, not " + std::string(name_of(model)));
  }
  if (views.size() < kMinViews) {
    return fail(ErrorCode::kDegenerate,
                std::to_string(views.size()) + " views of the board; 3 are the least");
  }
  Problem problem(model, size, views);
  auto state = problem.guess();
  if (!state) return fail(ErrorCode::kDegenerate, "no view shows enough of the board");
  problem.drop_hopeless(&*state);
  problem.minimize(kLinearAndFirstDistortion, &*state);
  problem.minimize(kAllValues, &*state);
  problem.reject_outliers(&*state);
  problem.minimize(kAllValues, &*state);
  return problem.report(*state, kAllValues);
}

}  // namespace cairn
