// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <new>

#include "common/base/reset_on_move.h"

namespace cairn {

/// Non-owning read-only view of 8-bit grey pixels; pixel (x, y) at data[y * stride + x].
struct GrayView {
  const uint8_t* data = nullptr;
  int width = 0;
  int height = 0;
  int stride = 0;  ///< bytes from row to row

  [[nodiscard]] const uint8_t* row(int y) const { return data + static_cast<ptrdiff_t>(y) * stride; }
  [[nodiscard]] uint8_t at(int x, int y) const { return row(y)[x]; }
  [[nodiscard]] bool empty() const { return width == 0 || height == 0; }
  /// Whether (x, y) lies at least `border` px inside.
  [[nodiscard]] bool contains(float x, float y, float border = 0) const {
    return x >= border && y >= border && x <= static_cast<float>(width - 1) - border &&
           y <= static_cast<float>(height - 1) - border;
  }
};

/// Owning 8-bit grey image: rows aligned to 64 bytes, 64 readable bytes beyond the last row (vector loads may
/// overrun). Move-only, and empty once moved from; share it as
/// shared_ptr<const GrayImage>. resize() keeps the memory when it suffices.
class GrayImage {
 public:
  GrayImage() = default;
  GrayImage(int width, int height) { resize(width, height); }
  explicit GrayImage(const GrayView& view) { assign(view); }

  void resize(int width, int height) {
    width_ = width;
    height_ = height;
    stride_ = (width + 63) / 64 * 64;
    const size_t bytes = static_cast<size_t>(stride_) * static_cast<size_t>(height) + 64;
    if (bytes > capacity_) {
      buffer_.reset(static_cast<uint8_t*>(::operator new[](bytes, std::align_val_t{64})));
      std::memset(buffer_.get(), 0, bytes);
      capacity_ = bytes;
    }
  }
  void assign(const GrayView& view) {
    resize(view.width, view.height);
    for (int y = 0; y < view.height; ++y) std::memcpy(row(y), view.row(y), static_cast<size_t>(view.width));
  }

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] int stride() const { return stride_; }
  [[nodiscard]] bool empty() const { return width_ == 0 || height_ == 0; }
  [[nodiscard]] uint8_t* row(int y) { return buffer_.get() + static_cast<ptrdiff_t>(y) * stride_; }
  [[nodiscard]] const uint8_t* row(int y) const {
    return buffer_.get() + static_cast<ptrdiff_t>(y) * stride_;
  }
  [[nodiscard]] GrayView view() const { return {buffer_.get(), width_, height_, stride_}; }
  operator GrayView() const { return view(); }  // NOLINT: a view of an image is what every reader wants

 private:
  struct AlignedDelete {
    void operator()(uint8_t* p) const { ::operator delete[](p, std::align_val_t{64}); }
  };
  std::unique_ptr<uint8_t[], AlignedDelete> buffer_;
  ResetOnMove<size_t> capacity_;
  ResetOnMove<int> width_;
  ResetOnMove<int> height_;
  ResetOnMove<int> stride_;
};

using GrayImagePtr = std::shared_ptr<const GrayImage>;

}  // namespace cairn
