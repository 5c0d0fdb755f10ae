// SPDX-License-Identifier: Apache-2.0
#include "common/bundle/reduced_system.h"

#include <algorithm>

namespace cairn {
namespace {

/// Which tiles of the lower half can become non-zero, row by row: the coupled ones, the diagonal, and what
/// the elimination of each tile column fills in.
std::vector<char> pattern(int side, const std::vector<std::vector<int>>& tracks) {
  std::vector<char> present(static_cast<size_t>(side * side), 0);
  const auto at = [&](int i, int j) -> char& { return present[static_cast<size_t>(i * side + j)]; };
  for (const std::vector<int>& track : tracks) {
    for (size_t a = 0; a < track.size(); ++a) {
      for (size_t b = 0; b <= a; ++b) at(track[a] / kPosesPerTile, track[b] / kPosesPerTile) = 1;
    }
  }
  for (int k = 0; k < side; ++k) {
    at(k, k) = 1;
    for (int i = k + 1; i < side; ++i) {
      if (!at(i, k)) continue;
      for (int j = k + 1; j <= i; ++j) at(i, j) |= at(j, k);
    }
  }
  return present;
}

}  // namespace

ReducedSystem::ReducedSystem(int poses, const std::vector<std::vector<int>>& tracks,
                             const TileKernels& kernels)
    : poses_(poses), side_((poses + kPosesPerTile - 1) / kPosesPerTile), kernels_(&kernels) {
  const std::vector<char> present = pattern(side_, tracks);
  storage_.resize(static_cast<size_t>(std::count(present.begin(), present.end(), 1)) * kTileElements);
  tiles_.resize(present.size(), nullptr);
  double* next = storage_.data();
  for (size_t t = 0; t < present.size(); ++t) {
    if (!present[t]) continue;
    tiles_[t] = next;
    next += kTileElements;
  }
}

void ReducedSystem::set_zero() {
  std::fill(storage_.begin(), storage_.end(), 0.0);
  // The last tile is only partly used: ones on the diagonal keep it positive definite.
  for (int row = poses_ * kPoseSize; row < side_ * kTileSize; ++row) {
    tile(side_ - 1, side_ - 1)[row % kTileSize * (kTileSize + 1)] = 1.0;
  }
}

void ReducedSystem::add_diagonal(int pose, const Eigen::Matrix<double, kPoseSize, kPoseSize>& block) {
  Eigen::Map<Eigen::Matrix<double, kPoseSize, kPoseSize>, 0, Eigen::OuterStride<kTileSize>> at(
      table().block(pose, pose));
  at += block;
}

ReducedSystem::Outcome ReducedSystem::factorize(const std::function<bool()>& should_stop) {
  for (int k = 0; k < side_; ++k) {
    if (!kernels_->factorize(tile(k, k))) return Outcome::kSingular;
    for (int i = k + 1; i < side_; ++i) {
      if (tile(i, k) == nullptr) continue;
      kernels_->divide(tile(k, k), tile(i, k));
      for (int j = k + 1; j <= i; ++j) {
        if (tile(j, k) != nullptr) kernels_->subtract_product(tile(i, k), tile(j, k), tile(i, j));
      }
      if (should_stop && should_stop()) return Outcome::kStopped;
    }
  }
  return Outcome::kDone;
}

void ReducedSystem::solve(Eigen::VectorXd* x) const {
  using Tile = Eigen::Map<const Eigen::Matrix<double, kTileSize, kTileSize>>;
  Eigen::VectorXd padded = Eigen::VectorXd::Zero(side_ * kTileSize);
  padded.head(x->size()) = *x;
  const auto part = [&](int i) {
    return Eigen::Map<Eigen::Matrix<double, kTileSize, 1>>(padded.data() + i * kTileSize);
  };
  for (int k = 0; k < side_; ++k) {
    auto x_k = part(k);
    Tile(tile(k, k)).triangularView<Eigen::Lower>().solveInPlace(x_k);
    for (int i = k + 1; i < side_; ++i) {
      if (tile(i, k) != nullptr) part(i).noalias() -= Tile(tile(i, k)) * x_k;
    }
  }
  for (int k = side_ - 1; k >= 0; --k) {
    auto x_k = part(k);
    for (int i = k + 1; i < side_; ++i) {
      if (tile(i, k) != nullptr) x_k.noalias() -= Tile(tile(i, k)).transpose() * part(i);
    }
    Tile(tile(k, k)).transpose().triangularView<Eigen::Upper>().solveInPlace(x_k);
  }
  *x = padded.head(x->size());
}

}  // namespace cairn
