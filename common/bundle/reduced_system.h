// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "common/bundle/tile_kernels.h"

/// The camera system that is left when points are eliminated.
namespace cairn {

/// A symmetric positive definite matrix of 6x6 blocks with a block-sparse Cholesky factorization. Stored and
/// factorized in dense tiles of 8x8 blocks: a map of one place is nearly dense, and a long one is dense near
/// the diagonal as keyframes follow the camera's path. Only the lower half is kept.
class ReducedSystem {
 public:
  /// `tracks`: for each point the poses that see it, ascending; these pairs of poses are coupled. Reserves
  /// what the factorization fills in as well.
  ReducedSystem(int poses, const std::vector<std::vector<int>>& tracks, const TileKernels& kernels);
  ReducedSystem(const ReducedSystem&) = delete;
  ReducedSystem& operator=(const ReducedSystem&) = delete;

  [[nodiscard]] int poses() const { return poses_; }
  [[nodiscard]] const TileKernels& kernels() const { return *kernels_; }
  [[nodiscard]] TileTable table() { return {tiles_.data(), side_}; }
  /// Bytes of all tiles that may hold anything but zero.
  [[nodiscard]] size_t bytes() const { return storage_.size() * sizeof(double); }

  void set_zero();
  /// Adds a symmetric block on the diagonal.
  void add_diagonal(int pose, const Eigen::Matrix<double, kPoseSize, kPoseSize>& block);

  enum class Outcome { kDone, kSingular, kStopped };
  /// Replaces the matrix by its factor. `should_stop` is polled about every half millisecond.
  [[nodiscard]] Outcome factorize(const std::function<bool()>& should_stop);
  /// Solves with the factor, in place. @param x 6 * poses() numbers
  void solve(Eigen::VectorXd* x) const;

 private:
  [[nodiscard]] double* tile(int i, int j) const { return tiles_[static_cast<size_t>(i * side_ + j)]; }

  int poses_;
  int side_;  ///< tiles
  const TileKernels* kernels_;
  std::vector<double> storage_;
  std::vector<double*> tiles_;  ///< side_ x side_, see TileTable
};

}  // namespace cairn
