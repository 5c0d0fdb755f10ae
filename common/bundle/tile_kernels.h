// SPDX-License-Identifier: Apache-2.0
#pragma once

/// The inner loops of the reduced camera system: dense algebra on square tiles, compiled for AVX2 and for the
/// SSE2 baseline. Both do the same operations on each element in the same order: they agree to the last bit.
namespace cairn {

constexpr int kPoseSize = 6;                          ///< of a pose's tangent
constexpr int kPosesPerTile = 8;                      ///< a tile and its two operands fit a 64 kB cache
constexpr int kTileSize = kPoseSize * kPosesPerTile;  ///< rows and columns
constexpr int kTileElements = kTileSize * kTileSize;
constexpr int kPointSize = 3;
constexpr int kSlotElements = kPoseSize * kPointSize;  ///< of a 6x3 block, by columns

/// Where the 6x6 block of a pair of poses lies. Tiles are stored by columns; `tiles` holds the address of
/// tile (i, j), i >= j, at [i * tiles_per_side + j], null where the system is structurally zero.
struct TileTable {
  double* const* tiles = nullptr;
  int tiles_per_side = 0;

  [[nodiscard]] double* block(int row, int column) const {
    double* tile = tiles[(row / kPosesPerTile) * tiles_per_side + column / kPosesPerTile];
    return tile + static_cast<long>(column % kPosesPerTile) * kPoseSize * kTileSize +
           static_cast<long>(row % kPosesPerTile) * kPoseSize;
  }
};

struct TileKernels {
  /// C -= A B^T.
  void (*subtract_product)(const double* a, const double* b, double* c);
  /// X <- X L^-T for a factor L made by factorize().
  void (*divide)(const double* l, double* x);
  /// A <- L with L L^T = A; what is above the diagonal is undefined. False when A is not positive definite.
  bool (*factorize)(double* a);
  /// Subtracts Z_i Z_j^T from block (poses[i], poses[j]) for all i >= j: a point's share of the Schur
  /// complement. `z`: `count` 6x3 blocks; `poses` ascending.
  void (*subtract_point)(const double* z, const int* poses, int count, const TileTable& table);
};

[[nodiscard]] const TileKernels& baseline_tile_kernels();
/// The variant of the kernels that runs fastest on this machine.
[[nodiscard]] const TileKernels& best_tile_kernels();

}  // namespace cairn
