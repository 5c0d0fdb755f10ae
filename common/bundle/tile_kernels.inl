// SPDX-License-Identifier: Apache-2.0
// No include guard: included once per instruction set by tile_kernels.cpp, inside a namespace and a target.

using Lanes = double __attribute__((vector_size(32), aligned(8), may_alias));
using HalfLanes = double __attribute__((vector_size(16), aligned(8), may_alias));
constexpr int kLanes = 4;

inline Lanes& lanes(double* p) {
  return *reinterpret_cast<Lanes*>(p);
}
inline const Lanes& lanes(const double* p) {
  return *reinterpret_cast<const Lanes*>(p);
}
inline HalfLanes& half_lanes(double* p) {
  return *reinterpret_cast<HalfLanes*>(p);
}
inline const HalfLanes& half_lanes(const double* p) {
  return *reinterpret_cast<const HalfLanes*>(p);
}

/// 8x4 elements of C in registers.
void subtract_product(const double* a, const double* b, double* c) {
  constexpr int kRows = 2 * kLanes;
  constexpr int kColumns = 4;
  for (int column = 0; column < kTileSize; column += kColumns) {
    for (int row = 0; row < kTileSize; row += kRows) {
      double* corner = c + column * kTileSize + row;
      Lanes sum[kColumns][2];
      for (int j = 0; j < kColumns; ++j) {
        sum[j][0] = lanes(corner + j * kTileSize);
        sum[j][1] = lanes(corner + j * kTileSize + kLanes);
      }
      const double* a_k = a + row;
      const double* b_k = b + column;
      for (int k = 0; k < kTileSize; ++k, a_k += kTileSize, b_k += kTileSize) {
        const Lanes top = lanes(a_k);
        const Lanes bottom = lanes(a_k + kLanes);
        for (int j = 0; j < kColumns; ++j) {
          sum[j][0] -= top * b_k[j];
          sum[j][1] -= bottom * b_k[j];
        }
      }
      for (int j = 0; j < kColumns; ++j) {
        lanes(corner + j * kTileSize) = sum[j][0];
        lanes(corner + j * kTileSize + kLanes) = sum[j][1];
      }
    }
  }
}

/// Column k of `x`, from row `first` on, less its share in the columns before: x_k -= sum_j x_j l_kj.
inline void subtract_columns(const double* l, int k, int first, double* x) {
  constexpr int kRows = 4 * kLanes;
  for (int row = first; row < kTileSize; row += kRows) {
    double* column = x + k * kTileSize + row;
    Lanes sum[4];
    for (int i = 0; i < 4; ++i) sum[i] = lanes(column + i * kLanes);
    const double* x_j = x + row;
    for (int j = 0; j < k; ++j, x_j += kTileSize) {
      const double l_kj = l[j * kTileSize + k];
      for (int i = 0; i < 4; ++i) sum[i] -= lanes(x_j + i * kLanes) * l_kj;
    }
    for (int i = 0; i < 4; ++i) lanes(column + i * kLanes) = sum[i];
  }
}

inline void scale_column(double factor, int k, int first, double* x) {
  double* column = x + k * kTileSize;
  for (int row = first; row < kTileSize; row += kLanes) lanes(column + row) *= factor;
}

void divide(const double* l, double* x) {
  for (int k = 0; k < kTileSize; ++k) {
    subtract_columns(l, k, 0, x);
    scale_column(1.0 / l[k * kTileSize + k], k, 0, x);
  }
}

bool factorise(double* a) {
  for (int k = 0; k < kTileSize; ++k) {
    const int first = k / (4 * kLanes) * (4 * kLanes);
    subtract_columns(a, k, first, a);
    const double pivot = a[k * kTileSize + k];
    if (!(pivot > 0) || !std::isfinite(pivot)) return false;
    const double root = std::sqrt(pivot);
    scale_column(1.0 / root, k, first, a);
    a[k * kTileSize + k] = root;
  }
  return true;
}

void subtract_point(const double* z, const int* poses, int count, const TileTable& table) {
  for (int i = 0; i < count; ++i) {
    const double* z_i = z + i * kSlotElements;
    const Lanes top[kPointSize] = {lanes(z_i), lanes(z_i + kPoseSize), lanes(z_i + 2 * kPoseSize)};
    const HalfLanes bottom[kPointSize] = {half_lanes(z_i + kLanes), half_lanes(z_i + kPoseSize + kLanes),
                                          half_lanes(z_i + 2 * kPoseSize + kLanes)};
    for (int j = 0; j <= i; ++j) {
      const double* z_j = z + j * kSlotElements;
      double* block = table.block(poses[i], poses[j]);
      for (int c = 0; c < kPoseSize; ++c, block += kTileSize) {
        const double b0 = z_j[c];
        const double b1 = z_j[c + kPoseSize];
        const double b2 = z_j[c + 2 * kPoseSize];
        lanes(block) -= top[0] * b0 + top[1] * b1 + top[2] * b2;
        half_lanes(block + kLanes) -= bottom[0] * b0 + bottom[1] * b1 + bottom[2] * b2;
      }
    }
  }
}

constexpr TileKernels kKernels{subtract_product, divide, factorise, subtract_point};
