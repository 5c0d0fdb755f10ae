// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/aruco.hpp>
#include <optional>
#include <string>

#include "client/app/calibrate/board.h"
#include "client/app/calibrate/tag_file.h"

namespace cairn {

/// Single tags anywhere on a plane, with a border of one bit or two.
class TagBoard final : public Board {
 public:
  /// `name`: of the plan, for describe().
  TagBoard(const std::string& name, TagPlan plan, cv::Ptr<cv::aruco::Dictionary> dictionary);
  [[nodiscard]] std::optional<BoardView> find(const GrayView& image) const override;
  [[nodiscard]] std::string describe() const override { return description_; }

 private:
  /// Finds the tags in an image if their border is `border` bits wide. Nothing where fewer than two are seen.
  [[nodiscard]] std::optional<BoardView> find(const GrayView& image, int border) const;

  std::string description_;
  TagPlan plan_;
  cv::Ptr<cv::aruco::Dictionary> dictionary_;
};

/// The view as it must be if the corners of each tag begin at another one: programs draw a family's tags
/// turned. `view`: four corners a tag. Of the four beginnings, the one that makes a plane's image of it.
[[nodiscard]] BoardView turn_tags(BoardView view);

}  // namespace cairn
