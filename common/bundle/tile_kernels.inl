// SPDX-License-Identifier: Apache-2.0
// No include guard: included once per instruction set by tile_kernels.cpp, inside a namespace and a target.

using Lanes = double __attribute__((vector_size(32)));
using HalfLanes = double __attribute__((vector_size(16)));
constexpr int kLanes = 4;

/// Of matrices, which are aligned as a double is. (A reference to a vector of less alignment keeps that with
/// GCC only.)
template <typename Vector>
struct __attribute__((packed, may_alias)) Unaligned {
  Vector lanes;
};
inline Lanes load(const double* p) {
  return reinterpret_cast<const Unaligned<Lanes>*>(p)->lanes;
}
inline HalfLanes load_half(const double* p) {
  return reinterpret_cast<const Unaligned<HalfLanes>*>(p)->lanes;
}
inline void store(const Lanes& lanes, double* p) {
  reinterpret_cast<Unaligned<Lanes>*>(p)->lanes = lanes;
}
inline void store(const HalfLanes& lanes, double* p) {
  reinterpret_cast<Unaligned<HalfLanes>*>(p)->lanes = lanes;
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
        sum[j][0] = load(corner + j * kTileSize);
        sum[j][1] = load(corner + j * kTileSize + kLanes);
      }
      const double* a_k = a + row;
      const double* b_k = b + column;
      for (int k = 0; k < kTileSize; ++k, a_k += kTileSize, b_k += kTileSize) {
        const Lanes top = load(a_k);
        const Lanes bottom = load(a_k + kLanes);
        for (int j = 0; j < kColumns; ++j) {
          sum[j][0] -= top * b_k[j];
          sum[j][1] -= bottom * b_k[j];
        }
      }
      for (int j = 0; j < kColumns; ++j) {
        store(sum[j][0], corner + j * kTileSize);
        store(sum[j][1], corner + j * kTileSize + kLanes);
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
    for (int i = 0; i < 4; ++i) sum[i] = load(column + i * kLanes);
    const double* x_j = x + row;
    for (int j = 0; j < k; ++j, x_j += kTileSize) {
      const double l_kj = l[j * kTileSize + k];
      for (int i = 0; i < 4; ++i) sum[i] -= load(x_j + i * kLanes) * l_kj;
    }
    for (int i = 0; i < 4; ++i) store(sum[i], column + i * kLanes);
  }
}

inline void scale_column(double factor, int k, int first, double* x) {
  double* column = x + k * kTileSize;
  for (int row = first; row < kTileSize; row += kLanes) store(load(column + row) * factor, column + row);
}

void divide(const double* l, double* x) {
  for (int k = 0; k < kTileSize; ++k) {
    subtract_columns(l, k, 0, x);
    scale_column(1.0 / l[k * kTileSize + k], k, 0, x);
  }
}

bool factorize(double* a) {
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
    const Lanes top[kPointSize] = {load(z_i), load(z_i + kPoseSize), load(z_i + 2 * kPoseSize)};
    const HalfLanes bottom[kPointSize] = {load_half(z_i + kLanes), load_half(z_i + kPoseSize + kLanes),
                                          load_half(z_i + 2 * kPoseSize + kLanes)};
    for (int j = 0; j <= i; ++j) {
      const double* z_j = z + j * kSlotElements;
      double* block = table.block(poses[i], poses[j]);
      for (int c = 0; c < kPoseSize; ++c, block += kTileSize) {
        const double b0 = z_j[c];
        const double b1 = z_j[c + kPoseSize];
        const double b2 = z_j[c + 2 * kPoseSize];
        store(load(block) - (top[0] * b0 + top[1] * b1 + top[2] * b2), block);
        store(load_half(block + kLanes) - (bottom[0] * b0 + bottom[1] * b1 + bottom[2] * b2), block + kLanes);
      }
    }
  }
}

constexpr TileKernels kKernels{subtract_product, divide, factorize, subtract_point};
