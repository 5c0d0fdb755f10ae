// SPDX-License-Identifier: Apache-2.0
#include "common/bundle/schur_complement.h"

#include <algorithm>
#include <cmath>

#include "common/geometry/robust.h"

namespace cairn {
namespace {

constexpr size_t kPointsPerPoll = 256;

/// Curvatures below this are those of a variable that nothing observes.
constexpr double kMinDiagonal = 1e-6;

using PoseBlock = Eigen::Matrix<double, kPoseSize, kPoseSize>;
using SlotMap = Eigen::Map<Eigen::Matrix<double, kPoseSize, kPointSize>>;

/// [x]M.
inline Eigen::Matrix3d cross_columns(const Eigen::Vector3d& x, const Eigen::Matrix3d& M) {
  Eigen::Matrix3d result;
  result.row(0) = x[1] * M.row(2) - x[2] * M.row(1);
  result.row(1) = x[2] * M.row(0) - x[0] * M.row(2);
  result.row(2) = x[0] * M.row(1) - x[1] * M.row(0);
  return result;
}

bool stops(const std::function<bool()>& should_stop) {
  return should_stop && should_stop();
}

}  // namespace

SchurComplement::SchurComplement(const BundleProblem& problem, const TileKernels& kernels)
    : border_(problem.free_cameras,
              static_cast<int>(std::count_if(problem.poses.begin(), problem.poses.end(),
                                             [](const BundlePose& p) { return !p.fixed; })),
              problem.points.size()) {
  column_of_pose_.assign(problem.poses.size(), -1);
  for (size_t i = 0; i < problem.poses.size(); ++i) {
    cameras_.push_back(problem.poses[i].camera.get());
    free_camera_.push_back(problem.poses[i].free_camera);
    if (problem.poses[i].fixed) continue;
    column_of_pose_[i] = static_cast<int>(pose_of_column_.size());
    pose_of_column_.push_back(static_cast<int>(i));
  }

  const size_t points = problem.points.size();
  for (size_t p = 0; p < points; ++p) is_fixed_point_.push_back(problem.is_fixed_point(p));
  first_observation_.assign(points + 1, 0);
  for (const BundleObservation& o : problem.observations)
    ++first_observation_[static_cast<size_t>(o.point) + 1];
  for (size_t i = 0; i < points; ++i) first_observation_[i + 1] += first_observation_[i];
  std::vector<int> next(first_observation_.begin(), first_observation_.end() - 1);
  observations_.resize(problem.observations.size());
  for (const BundleObservation& o : problem.observations) {
    const auto at = static_cast<size_t>(next[static_cast<size_t>(o.point)]++);
    observations_[at] = {o.pose, -1, o.pixel, o.inverse_sigma};
  }

  std::vector<std::vector<int>> tracks(points);
  first_slot_.assign(1, 0);
  for (size_t p = 0; p < points; ++p) {
    const auto begin = observations_.begin() + first_observation_[p];
    const auto end = observations_.begin() + first_observation_[p + 1];
    std::stable_sort(begin, end, [](const auto& a, const auto& b) { return a.pose < b.pose; });
    for (auto o = begin; o != end; ++o) {
      const int column = column_of_pose_[static_cast<size_t>(o->pose)];
      if (column < 0 || is_fixed_point_[p]) continue;
      if (tracks[p].empty() || tracks[p].back() != column) tracks[p].push_back(column);
      o->slot = first_slot_.back() + static_cast<int>(tracks[p].size()) - 1;
    }
    column_of_slot_.insert(column_of_slot_.end(), tracks[p].begin(), tracks[p].end());
    first_slot_.push_back(static_cast<int>(column_of_slot_.size()));
  }
  slots_.resize(column_of_slot_.size() * kSlotElements);
  factors_.resize(points);
  sums_.resize(pose_of_column_.size());
  reduced_.emplace(static_cast<int>(pose_of_column_.size()), tracks, kernels);
}

std::vector<SchurComplement::View> SchurComplement::views(const BundleState& state) const {
  std::vector<View> views;
  views.reserve(state.poses.size());
  for (size_t i = 0; i < state.poses.size(); ++i) {
    const int free = free_camera_[i];
    const Camera* camera = free < 0 ? cameras_[i] : state.free_cameras[static_cast<size_t>(free)].get();
    views.push_back(
        {state.poses[i].rotation_matrix(), state.poses[i].translation(), camera, column_of_pose_[i], free});
  }
  return views;
}

double SchurComplement::cost(const BundleState& state, double squared_cutoff) const {
  const std::vector<View> views = this->views(state);
  double sum = border_.prior_cost(state.free_cameras, squared_cutoff);
  for (size_t p = 0; p < state.points.size(); ++p) {
    for (int i = first_observation_[p]; i < first_observation_[p + 1]; ++i) {
      const Observation& o = observations_[static_cast<size_t>(i)];
      const View& view = views[static_cast<size_t>(o.pose)];
      const auto pixel = view.camera->project(view.rotation * state.points[p] + view.translation);
      const double squared =
          pixel ? (*pixel - o.pixel).squaredNorm() * o.inverse_sigma * o.inverse_sigma : squared_cutoff;
      sum += tukey_cost(squared, squared_cutoff);
    }
  }
  return sum;
}

std::optional<double> SchurComplement::linearize(const BundleState& state, double squared_cutoff,
                                                 double lambda, const std::function<bool()>& should_stop) {
  const std::vector<View> views = this->views(state);
  lambda_ = lambda;
  reduced_->set_zero();
  right_side_.setZero(static_cast<Eigen::Index>(sums_.size()) * kPoseSize);
  for (PoseSums& s : sums_) {
    s.top_left.setZero();
    s.bottom_left.setZero();
    s.bottom_right.setZero();
    s.gradient.setZero();
  }
  std::fill(slots_.begin(), slots_.end(), 0.0);
  border_.set_zero();
  double cost = border_.prior_cost(state.free_cameras, squared_cutoff);
  for (size_t p = 0; p < state.points.size(); ++p) {
    if (p % kPointsPerPoll == 0 && stops(should_stop)) return std::nullopt;
    Eigen::Matrix3d V;
    Eigen::Vector3d g;
    cost += accumulate(views, p, state.points[p], squared_cutoff, &V, &g);
    eliminate(p, lambda, V, g);
  }
  add_pose_blocks(lambda);
  border_.finish(state.free_cameras, squared_cutoff, lambda);
  return cost;
}

double SchurComplement::accumulate(const std::vector<View>& views, size_t point,
                                   const Eigen::Vector3d& position, double squared_cutoff, Eigen::Matrix3d* V,
                                   Eigen::Vector3d* g) {
  V->setZero();
  g->setZero();
  double cost = 0;
  for (int i = first_observation_[point]; i < first_observation_[point + 1]; ++i) {
    const Observation& o = observations_[static_cast<size_t>(i)];
    const View& view = views[static_cast<size_t>(o.pose)];
    const Eigen::Vector3d x = view.rotation * position + view.translation;
    Matrix23d A;
    const auto pixel = view.camera->project(x, &A);
    const Eigen::Vector2d r =
        pixel ? Eigen::Vector2d((*pixel - o.pixel) * o.inverse_sigma) : Eigen::Vector2d();
    const double squared = pixel ? r.squaredNorm() : squared_cutoff;
    cost += tukey_cost(squared, squared_cutoff);
    if (!(squared < squared_cutoff)) continue;

    const double weight = tukey_weight(squared, squared_cutoff);
    const Matrix23d wA = (weight * o.inverse_sigma) * A;
    const Eigen::Vector3d e = wA.transpose() * r;
    const Eigen::Matrix3d M = o.inverse_sigma * (wA.transpose() * A);
    const Eigen::Matrix3d N = M * view.rotation;
    V->noalias() += view.rotation.transpose() * N;
    g->noalias() += view.rotation.transpose() * e;
    if (view.free_camera >= 0) {
      const Eigen::Matrix2d J = o.inverse_sigma * d_pixel_d_intrinsics(*view.camera, x);
      border_.add({view.free_camera, view.column, weight, J, r, J.transpose() * (o.inverse_sigma * A), x,
                   view.rotation});
    }
    if (view.column < 0) continue;

    if (o.slot >= 0) {
      SlotMap W(slots_.data() + static_cast<ptrdiff_t>(o.slot) * kSlotElements);
      W.topRows<3>() += N;
      W.bottomRows<3>() += cross_columns(x, N);
    }
    PoseSums& sums = sums_[static_cast<size_t>(view.column)];
    const Eigen::Matrix3d xM = cross_columns(x, M);
    sums.top_left += M;
    sums.bottom_left += xM;
    sums.bottom_right += cross_columns(x, xM.transpose());
    sums.gradient.head<3>() += e;
    sums.gradient.tail<3>() += x.cross(e);
  }
  return cost;
}

void SchurComplement::eliminate(size_t point, double lambda, const Eigen::Matrix3d& V,
                                const Eigen::Vector3d& g) {
  PointFactor& f = factors_[point];
  f.gradient = g;
  f.diagonal = V.diagonal().cwiseMax(kMinDiagonal);
  const Eigen::Vector3d d = V.diagonal() + lambda * f.diagonal;
  Eigen::Vector3d& inverse = f.inverse_diagonal;
  Eigen::Vector3d& l = f.lower;
  inverse[0] = 1.0 / std::sqrt(d[0]);
  l[0] = V(1, 0) * inverse[0];
  l[1] = V(2, 0) * inverse[0];
  inverse[1] = 1.0 / std::sqrt(d[1] - l[0] * l[0]);
  l[2] = (V(2, 1) - l[1] * l[0]) * inverse[1];
  inverse[2] = 1.0 / std::sqrt(d[2] - l[1] * l[1] - l[2] * l[2]);
  if (is_fixed_point_[point] || !inverse.allFinite()) {  // stays where it is
    inverse.setZero();
    l.setZero();
  }
  f.y[0] = g[0] * inverse[0];
  f.y[1] = (g[1] - l[0] * f.y[0]) * inverse[1];
  f.y[2] = (g[2] - l[1] * f.y[0] - l[2] * f.y[1]) * inverse[2];

  const int begin = first_slot_[point];
  const int end = first_slot_[point + 1];
  for (int s = begin; s < end; ++s) {
    SlotMap Z(slots_.data() + static_cast<ptrdiff_t>(s) * kSlotElements);
    Z.col(0) *= inverse[0];
    Z.col(1) = (Z.col(1) - l[0] * Z.col(0)) * inverse[1];
    Z.col(2) = (Z.col(2) - l[1] * Z.col(0) - l[2] * Z.col(1)) * inverse[2];
    right_side_.segment<kPoseSize>(column_of_slot_[static_cast<size_t>(s)] * kPoseSize).noalias() -= Z * f.y;
  }
  reduced_->kernels().subtract_point(slots_.data() + static_cast<ptrdiff_t>(begin) * kSlotElements,
                                     column_of_slot_.data() + begin, end - begin, reduced_->table());
  if (border_.empty()) return;
  const auto count = static_cast<size_t>(end - begin);
  border_.eliminate(point, inverse, l, f.y,
                    {slots_.data() + static_cast<ptrdiff_t>(begin) * kSlotElements, count * kSlotElements},
                    {column_of_slot_.data() + begin, count});
}

void SchurComplement::add_pose_blocks(double lambda) {
  for (size_t c = 0; c < sums_.size(); ++c) {
    const PoseSums& s = sums_[c];
    PoseBlock U;
    U << s.top_left, s.bottom_left.transpose(), s.bottom_left, s.bottom_right;
    U.diagonal() += lambda * U.diagonal().cwiseMax(kMinDiagonal);
    reduced_->add_diagonal(static_cast<int>(c), U);
    right_side_.segment<kPoseSize>(static_cast<Eigen::Index>(c) * kPoseSize) += s.gradient;
  }
}

ReducedSystem::Outcome SchurComplement::solve(BundleStep* step, const std::function<bool()>& should_stop) {
  const auto outcome = reduced_->factorize(should_stop);
  if (outcome != ReducedSystem::Outcome::kDone) return outcome;
  reduced_->solve(&right_side_);
  double decrease = 0;  // (lambda d^T D d - g^T d) / 2
  step->free_cameras.clear();
  if (!border_.empty()) {
    border_.solve(*reduced_, &right_side_);
    decrease += border_.decrease();
    for (Eigen::Index c = 0; c < border_.step().size(); c += kIntrinsics)
      step->free_cameras.emplace_back(border_.step().segment<kIntrinsics>(c));
  }
  step->poses.resize(sums_.size());
  for (size_t c = 0; c < sums_.size(); ++c) {
    const Vector6d d = -right_side_.segment<kPoseSize>(static_cast<Eigen::Index>(c) * kPoseSize);
    Vector6d diagonal;
    diagonal << sums_[c].top_left.diagonal(), sums_[c].bottom_right.diagonal();
    diagonal = diagonal.cwiseMax(kMinDiagonal);
    decrease += lambda_ * d.cwiseProduct(diagonal).dot(d) - sums_[c].gradient.dot(d);
    step->poses[c] = d;
  }
  step->points.resize(factors_.size());
  for (size_t p = 0; p < factors_.size(); ++p) {
    const PointFactor& f = factors_[p];
    Eigen::Vector3d t = f.y;
    if (!border_.empty()) t += border_.back_substitute(p);
    for (int s = first_slot_[p]; s < first_slot_[p + 1]; ++s) {
      const SlotMap Z(slots_.data() + static_cast<ptrdiff_t>(s) * kSlotElements);
      t.noalias() +=
          Z.transpose() * step->poses[static_cast<size_t>(column_of_slot_[static_cast<size_t>(s)])];
    }
    Eigen::Vector3d d;
    d[2] = -t[2] * f.inverse_diagonal[2];
    d[1] = (-t[1] - f.lower[2] * d[2]) * f.inverse_diagonal[1];
    d[0] = (-t[0] - f.lower[0] * d[1] - f.lower[1] * d[2]) * f.inverse_diagonal[0];
    decrease += lambda_ * d.cwiseProduct(f.diagonal).dot(d) - f.gradient.dot(d);
    step->points[p] = d;
  }
  step->predicted_decrease = 0.5 * decrease;
  return outcome;
}

void SchurComplement::apply(const BundleStep& step, const BundleState& from, BundleState* to) const {
  *to = from;
  for (size_t c = 0; c < step.poses.size(); ++c) {
    SE3& pose = to->poses[static_cast<size_t>(pose_of_column_[c])];
    pose = SE3::exp(step.poses[c]) * pose;
  }
  for (size_t p = 0; p < step.points.size(); ++p) to->points[p] += step.points[p];
  for (size_t c = 0; c < step.free_cameras.size(); ++c) {
    const Camera& before = *from.free_cameras[c];
    // A step that leaves no camera leaves no poses either: it is not taken.
    if (auto camera = with_intrinsics(before, intrinsics_of(before) + step.free_cameras[c]))
      to->free_cameras[c] = std::move(camera);
  }
}

std::optional<std::vector<Eigen::Matrix2d>> SchurComplement::camera_covariances(
    const BundleState& state, double squared_cutoff, const std::function<bool()>& should_stop) {
  constexpr double kFreeScale = 1e-8;  // damping against the free scale, which the cameras do not feel
  if (!linearize(state, squared_cutoff, kFreeScale, should_stop)) return std::nullopt;
  if (reduced_->factorize(should_stop) != ReducedSystem::Outcome::kDone) return std::nullopt;
  const Eigen::MatrixXd all = border_.inverse_curvature(*reduced_);
  std::vector<Eigen::Matrix2d> covariances;
  for (Eigen::Index c = 0; c < all.cols(); c += kIntrinsics)
    covariances.emplace_back(all.block<kIntrinsics, kIntrinsics>(c, c));
  return covariances;
}

}  // namespace cairn
