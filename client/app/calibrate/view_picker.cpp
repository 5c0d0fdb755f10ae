// SPDX-License-Identifier: Apache-2.0
#include "client/app/calibrate/view_picker.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "client/app/calibrate/board_pose.h"

namespace cairn {
namespace {

constexpr double kMaxEdgeWidth = 6;  ///< [px]: blur of sigma 2.4
constexpr double kMinDifference = 0.2;
constexpr size_t kMaxViews = 80;
constexpr double kSharper = 0.9;  ///< of the kept one's edge width, to replace it

/// The value below which `fraction` of a histogram lies.
double quantile(const std::vector<size_t>& histogram, double fraction) {
  size_t total = 0;
  for (const size_t n : histogram) total += n;
  size_t sum = 0;
  for (size_t value = 0; value < histogram.size(); ++value) {
    sum += histogram[value];
    if (static_cast<double>(sum) >= fraction * static_cast<double>(total)) return static_cast<double>(value);
  }
  return 0;
}

}  // namespace

double edge_width(const GrayView& image, const BoardView& view) {
  Eigen::AlignedBox2d box;
  for (const auto& pixel : view.pixels) box.extend(pixel);
  const int x0 = std::max(1, static_cast<int>(box.min().x()));
  const int y0 = std::max(1, static_cast<int>(box.min().y()));
  const int x1 = std::min(image.width - 2, static_cast<int>(box.max().x()));
  const int y1 = std::min(image.height - 2, static_cast<int>(box.max().y()));
  std::vector<size_t> levels(256, 0);
  std::vector<size_t> slopes(512, 0);
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      ++levels[image.at(x, y)];
      const int dx = image.at(x + 1, y) - image.at(x - 1, y);
      const int dy = image.at(x, y + 1) - image.at(x, y - 1);
      ++slopes[static_cast<size_t>(std::hypot(dx, dy))];
    }
  }
  const double contrast = quantile(levels, 0.95) - quantile(levels, 0.05);
  const double steepest = 0.5 * quantile(slopes, 0.99);
  return steepest > 0 ? contrast / steepest : static_cast<double>(image.width);
}

std::optional<ViewPicker::Aspect> ViewPicker::aspect_of(const BoardView& view) const {
  std::vector<Eigen::Vector3d> pixels;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  Eigen::Vector2d board_centre = Eigen::Vector2d::Zero();
  for (size_t i = 0; i < view.size(); ++i) {
    const Eigen::Vector2d pixel = view.pixels[i] / size_.width;
    pixels.push_back(pixel.homogeneous());
    centre += pixel;
    board_centre += view.on_board[i].head<2>();
  }
  centre /= static_cast<double>(view.size());
  board_centre /= static_cast<double>(view.size());
  auto h = board_homography(view.on_board, pixels);
  if (!h) return std::nullopt;
  const Eigen::Vector3d at = *h * board_centre.homogeneous();
  // Pixels by board there, and how the depth's logarithm changes over the image: its slope is the tilt.
  const Eigen::Vector2d image = at.head<2>() / at.z();
  const Eigen::Matrix2d affine = (h->topLeftCorner<2, 2>() - image * h->bottomLeftCorner<1, 2>()) / at.z();
  const Eigen::Vector2d depth_by_board = h->bottomLeftCorner<1, 2>().transpose() / at.z();
  if (!(std::abs(affine.determinant()) > 0)) return std::nullopt;
  const Eigen::Vector2d tilt = affine.transpose().inverse() * depth_by_board;
  double extent = 0;
  for (const auto& pixel : pixels) extent += (pixel.head<2>() - centre).squaredNorm();
  extent = std::sqrt(extent / static_cast<double>(view.size()));
  return Aspect{centre.x(), centre.y(), std::log2(extent), 0.5 * tilt.x(), 0.5 * tilt.y()};
}

ViewPicker::Outcome ViewPicker::offer(const BoardView& view, double edge_width) {
  if (edge_width > kMaxEdgeWidth) return Outcome::kBlurred;
  const auto aspect = aspect_of(view);
  if (!aspect) return Outcome::kLikeAnother;
  for (Kept& kept : kept_) {
    double difference = 0;
    for (size_t i = 0; i < aspect->size(); ++i) difference += std::abs((*aspect)[i] - kept.aspect[i]);
    if (difference >= kMinDifference) continue;
    if (edge_width > kSharper * kept.edge_width || view.size() < kept.view.size())
      return Outcome::kLikeAnother;
    kept = {view, *aspect, edge_width};
    return Outcome::kReplacedABlurrierOne;
  }
  if (kept_.size() >= kMaxViews) return Outcome::kFull;
  kept_.push_back({view, *aspect, edge_width});
  return Outcome::kKept;
}

std::vector<BoardView> ViewPicker::views() const {
  std::vector<BoardView> views;
  for (const auto& kept : kept_) views.push_back(kept.view);
  return views;
}

}  // namespace cairn
