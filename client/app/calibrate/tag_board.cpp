// SPDX-License-Identifier: Apache-2.0
#include "client/app/calibrate/tag_board.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "client/app/calibrate/board_pose.h"
#include "client/app/calibrate/tag_corners.h"

namespace cairn {
namespace {

constexpr size_t kCorners = 4;  ///< of a tag

/// Squared distances [px^2] from what the plane's best homography says; infinite if there is none.
double misfit(const BoardView& view) {
  std::vector<Eigen::Vector3d> rays;
  rays.reserve(view.size());
  constexpr double kFocalLength = 1000;  // any will do: a homography takes it in
  for (const Eigen::Vector2d& pixel : view.pixels) rays.emplace_back(pixel.x(), pixel.y(), kFocalLength);
  const auto h = board_homography(view.on_board, rays);
  if (!h) return std::numeric_limits<double>::infinity();
  double sum = 0;
  for (size_t i = 0; i < view.size(); ++i) {
    const Eigen::Vector3d ray = *h * view.on_board[i].head<2>().homogeneous();
    sum += (kFocalLength * ray.head<2>() / ray.z() - view.pixels[i]).squaredNorm();
  }
  return sum;
}

}  // namespace

BoardView turn_tags(BoardView view) {
  BoardView best = view;
  double least = std::numeric_limits<double>::infinity();
  for (size_t turn = 0; turn < kCorners; ++turn) {
    if (const double sum = misfit(view); sum < least) {
      least = sum;
      best = view;
    }
    for (auto tag = view.on_board.begin(); tag != view.on_board.end(); tag += kCorners)
      std::rotate(tag, tag + 1, tag + kCorners);
  }
  return best;
}

TagBoard::TagBoard(const std::string& name, TagPlan plan, cv::Ptr<cv::aruco::Dictionary> dictionary)
    : description_(std::to_string(plan.tags.size()) + " tags of " + name),
      plan_(std::move(plan)),
      dictionary_(std::move(dictionary)) {}

std::optional<BoardView> TagBoard::find(const GrayView& image) const {
  auto view = find(image, plan_.border);
  return view ? view : find(image, 3 - plan_.border);
}

std::optional<BoardView> TagBoard::find(const GrayView& image, int border) const {
  const cv::Mat pixels(image.height, image.width, CV_8U, const_cast<uint8_t*>(image.data),
                       static_cast<size_t>(image.stride));
  const auto parameters = cv::aruco::DetectorParameters::create();
  parameters->markerBorderBits = border;
  parameters->cornerRefinementMethod = cv::aruco::CORNER_REFINE_NONE;  // refine_tag_corners() does it
  std::vector<std::vector<cv::Point2f>> found;
  std::vector<int> ids;
  cv::aruco::detectMarkers(pixels, dictionary_, found, ids, parameters);
  BoardView view;
  for (size_t i = 0; i < ids.size(); ++i) {
    const auto tag = plan_.tags.find(ids[i]);
    if (tag == plan_.tags.end()) continue;
    TagCorners seen;
    for (size_t k = 0; k < kCorners; ++k) seen[k] = {found[i][k].x, found[i][k].y};
    const auto corners = refine_tag_corners(image, seen, dictionary_->markerSize + 2 * border);
    if (!corners) continue;
    view.on_board.insert(view.on_board.end(), tag->second.begin(), tag->second.end());
    view.pixels.insert(view.pixels.end(), corners->begin(), corners->end());
  }
  constexpr size_t kFewestTags = 2;
  if (view.size() < kFewestTags * kCorners) return std::nullopt;
  return turn_tags(std::move(view));
}

}  // namespace cairn
