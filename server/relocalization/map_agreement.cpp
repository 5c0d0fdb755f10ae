// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/map_agreement.h"

#include <algorithm>
#include <array>

namespace cairn {
namespace {

Eigen::Quaterniond other_from_one(const SharedView& view) {
  return view.camera_from_other.rotation().conjugate() * view.camera_from_one.rotation();
}

/// Rotations averaged as quaternions: they are close to each other, or nothing will agree.
Eigen::Quaterniond mean_rotation(std::span<const SharedView* const> views) {
  Eigen::Vector4d sum = Eigen::Vector4d::Zero();
  for (const SharedView* view : views) {
    const Eigen::Vector4d q = other_from_one(*view).coeffs();
    sum += q.dot(sum) < 0 ? (-q).eval() : q;
  }
  return Eigen::Quaterniond(sum).normalized();
}

/// Least squares over the centres, with the rotation that the cameras have: two views are enough, where
/// centres alone would need three that lie on no line. Nothing if the centres coincide, or if the two maps
/// place them oppositely.
std::optional<Similarity3> fit(std::span<const SharedView* const> views) {
  const Eigen::Quaterniond rotation = mean_rotation(views);
  Eigen::Vector3d mean_one = Eigen::Vector3d::Zero();
  Eigen::Vector3d mean_other = Eigen::Vector3d::Zero();
  for (const SharedView* view : views) {
    mean_one += view->camera_from_one.center();
    mean_other += view->camera_from_other.center();
  }
  mean_one /= static_cast<double>(views.size());
  mean_other /= static_cast<double>(views.size());
  double along = 0;
  double squared = 0;
  for (const SharedView* view : views) {
    const Eigen::Vector3d turned = rotation * (view->camera_from_one.center() - mean_one);
    along += turned.dot(view->camera_from_other.center() - mean_other);
    squared += turned.squaredNorm();
  }
  if (!(along > 0) || !(squared > 0)) return std::nullopt;
  const double scale = along / squared;
  return Similarity3(scale, rotation, mean_other - scale * (rotation * mean_one));
}

double error_of(const SharedView& view, const Similarity3& other_from_one) {
  const double depth = std::min(view.depth_in_other, other_from_one.scale() * view.depth_in_one);
  return separation(other_from_one.transform_camera(view.camera_from_one), view.camera_from_other, depth);
}

bool do_lie_apart(const SharedView& a, const SharedView& b, double least_base) {
  const double in_one = (a.camera_from_one.center() - b.camera_from_one.center()).norm();
  const double in_other = (a.camera_from_other.center() - b.camera_from_other.center()).norm();
  return in_one >= least_base * std::min(a.depth_in_one, b.depth_in_one) &&
         in_other >= least_base * std::min(a.depth_in_other, b.depth_in_other);
}

struct Vote {
  std::vector<size_t> agreeing;
  double error = 0;  ///< summed over these
};

Vote count(std::span<const SharedView> views, const Similarity3& other_from_one, double same_pose) {
  Vote vote;
  for (size_t i = 0; i < views.size(); ++i) {
    const double error = error_of(views[i], other_from_one);
    if (!(error <= same_pose)) continue;
    vote.agreeing.push_back(i);
    vote.error += error;
  }
  return vote;
}

bool is_better(const Vote& a, const Vote& b) {
  if (a.agreeing.size() != b.agreeing.size()) return a.agreeing.size() > b.agreeing.size();
  return a.error < b.error;
}

}  // namespace

double separation(const SE3& a, const SE3& b, double depth) {
  constexpr double kLeastDepth = 1e-9;
  return (a.center() - b.center()).norm() / std::max(depth, kLeastDepth) +
         a.rotation().angularDistance(b.rotation());
}

std::optional<MapAgreement> find_agreement(std::span<const SharedView> views,
                                           const MapAgreementOptions& options) {
  Vote best;
  for (size_t i = 0; i < views.size(); ++i) {
    for (size_t j = i + 1; j < views.size(); ++j) {
      if (!do_lie_apart(views[i], views[j], options.least_base)) continue;
      const auto hypothesis = fit(std::array{&views[i], &views[j]});
      if (!hypothesis) continue;
      Vote vote = count(views, *hypothesis, options.same_pose);
      const bool holds_both =
          std::ranges::binary_search(vote.agreeing, i) && std::ranges::binary_search(vote.agreeing, j);
      if (holds_both && is_better(vote, best)) best = std::move(vote);
    }
  }
  if (best.agreeing.empty()) return std::nullopt;
  std::vector<const SharedView*> agreeing;
  for (const size_t i : best.agreeing) agreeing.push_back(&views[i]);
  const auto all = fit(agreeing);
  if (!all) return std::nullopt;
  return MapAgreement{*all, std::move(best.agreeing)};
}

}  // namespace cairn
