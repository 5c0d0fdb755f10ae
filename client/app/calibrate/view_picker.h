// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "client/app/calibrate/solver.h"
#include "common/image/image.h"

namespace cairn {

/// Width of the edges on the board [px]: contrast over steepest slope. 2 for a perfectly sharp image; grows
/// with blur by motion or defocus.
[[nodiscard]] double edge_width(const GrayView& image, const BoardView& view);

/// Keeps the views of a board that are sharp and differ from each other; of two alike, the sharper one.
class ViewPicker {
 public:
  explicit ViewPicker(ImageSize size) : size_(size) {}

  enum class Outcome {
    kKept,
    kReplacedABlurrierOne,
    kLikeAnother,
    kBlurred,
    kFull,
  };
  Outcome offer(const BoardView& view, double edge_width);

  [[nodiscard]] std::vector<BoardView> views() const;
  [[nodiscard]] size_t size() const { return kept_.size(); }

 private:
  /// Where in the image the board is seen, how large, and how tilted to either side; 1 is a good part of an
  /// image.
  using Aspect = std::array<double, 5>;
  struct Kept {
    BoardView view;
    Aspect aspect;
    double edge_width;
  };
  [[nodiscard]] std::optional<Aspect> aspect_of(const BoardView& view) const;

  ImageSize size_;
  std::vector<Kept> kept_;
};

}  // namespace cairn
