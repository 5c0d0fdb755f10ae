// SPDX-License-Identifier: Apache-2.0
#include "client/app/calibrate/board.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/aruco.hpp>
#include <opencv2/aruco/charuco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <string_view>
#include <utility>
#include <vector>

#include "client/app/calibrate/tag_board.h"
#include "client/app/calibrate/tag_file.h"

namespace cairn {
namespace {

constexpr size_t kMinPoints = 8;  ///< fewer make no view

struct NamedDictionary {
  std::string_view name;
  cv::aruco::PREDEFINED_DICTIONARY_NAME id;
};
constexpr std::array kDictionaries = {
    NamedDictionary{"4x4_50", cv::aruco::DICT_4X4_50},
    NamedDictionary{"4x4_100", cv::aruco::DICT_4X4_100},
    NamedDictionary{"4x4_250", cv::aruco::DICT_4X4_250},
    NamedDictionary{"5x5_50", cv::aruco::DICT_5X5_50},
    NamedDictionary{"5x5_100", cv::aruco::DICT_5X5_100},
    NamedDictionary{"5x5_250", cv::aruco::DICT_5X5_250},
    NamedDictionary{"6x6_50", cv::aruco::DICT_6X6_50},
    NamedDictionary{"6x6_250", cv::aruco::DICT_6X6_250},
    NamedDictionary{"aruco_original", cv::aruco::DICT_ARUCO_ORIGINAL},
    NamedDictionary{"apriltag_16h5", cv::aruco::DICT_APRILTAG_16h5},
    NamedDictionary{"apriltag_25h9", cv::aruco::DICT_APRILTAG_25h9},
    NamedDictionary{"apriltag_36h11", cv::aruco::DICT_APRILTAG_36h11},
};

Result<cv::Ptr<cv::aruco::Dictionary>> dictionary_of(const std::string& name) {
  std::string names;
  for (const auto& known : kDictionaries) {
    if (known.name == name) return cv::aruco::getPredefinedDictionary(known.id);
    names += (names.empty() ? "" : ", ") + std::string(known.name);
  }
  return fail(ErrorCode::kUsage, "no dictionary '" + name + "'; there are " + names);
}

/// The pixels stay where they are: the view must outlive the result.
cv::Mat as_mat(const GrayView& view) {
  return {view.height, view.width, CV_8U, const_cast<uint8_t*>(view.data), static_cast<size_t>(view.stride)};
}

std::string size_text(const BoardDescription& board) {
  return std::to_string(board.columns) + "x" + std::to_string(board.rows) + " squares";
}

/// The crossing of squares near `start`, from a window of 2 `half` + 1 pixels a side, smaller at the
/// image's edge; nothing if there is none.
std::optional<cv::Point2f> refine(const cv::Mat& pixels, const cv::Point2f& start, int half) {
  constexpr int kMinHalf = 2;
  constexpr float kRim = 2;  // of gradients, between pixels
  const float room = std::min({start.x, start.y, static_cast<float>(pixels.cols - 1) - start.x,
                               static_cast<float>(pixels.rows - 1) - start.y});
  if (!(room >= kMinHalf + kRim)) return std::nullopt;
  half = std::clamp(half, kMinHalf, static_cast<int>(room - kRim));
  const cv::TermCriteria criteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 40, 0.001);
  std::vector<cv::Point2f> corner = {start};
  cv::cornerSubPix(pixels, corner, {half, half}, {-1, -1}, criteria);
  constexpr double kMaxShift = 1.5;
  if (cv::norm(corner.front() - start) > kMaxShift) return std::nullopt;
  return corner.front();
}

class Chessboard final : public Board {
 public:
  explicit Chessboard(const BoardDescription& description) : board_(description) {}

  std::optional<BoardView> find(const GrayView& image) const override {
    const cv::Mat pixels = as_mat(image);
    std::vector<cv::Point2f> corners;
    const cv::Size inner(board_.columns - 1, board_.rows - 1);
    if (!cv::findChessboardCornersSB(pixels, inner, corners, cv::CALIB_CB_NORMALIZE_IMAGE))
      return std::nullopt;
    BoardView view;
    for (int y = 0; y < inner.height; ++y) {
      for (int x = 0; x < inner.width; ++x) {
        const auto corner = [&](int column, int row) {
          return corners[static_cast<size_t>(row * inner.width + column)];
        };
        const double side = std::min(cv::norm(corner(x, y) - corner(x > 0 ? x - 1 : x + 1, y)),
                                     cv::norm(corner(x, y) - corner(x, y > 0 ? y - 1 : y + 1)));
        // As found they are 0.15 to 0.2 px off (rms), neighbours in the same direction: too much for a
        // fisheye.
        constexpr double kWindow = 0.25;  // of a square
        constexpr int kMaxHalf = 10;
        const int half = std::min(static_cast<int>(kWindow * side), kMaxHalf);
        const auto pixel = refine(pixels, corner(x, y), half);
        if (!pixel) continue;
        view.on_board.emplace_back(x * board_.square, y * board_.square, 0);
        view.pixels.emplace_back(pixel->x, pixel->y);
      }
    }
    if (view.size() < std::min(kMinPoints, corners.size())) return std::nullopt;
    return view;
  }
  std::string describe() const override { return "chessboard of " + size_text(board_); }

 private:
  BoardDescription board_;
};

struct SeenMarkers {
  std::vector<std::vector<cv::Point2f>> corners;
  std::vector<int> ids;
};

class Charuco final : public Board {
 public:
  using Pattern = cv::Ptr<cv::aruco::CharucoBoard>;
  Charuco(const BoardDescription& description, std::vector<Pattern> patterns)
      : board_(description), patterns_(std::move(patterns)) {}

  std::optional<BoardView> find(const GrayView& image) const override {
    const cv::Mat pixels = as_mat(image);
    SeenMarkers seen;
    cv::aruco::detectMarkers(pixels, patterns_.front()->dictionary, seen.corners, seen.ids);
    if (seen.ids.empty()) return std::nullopt;
    BoardView best;
    for (const Pattern& pattern : patterns_) {
      BoardView view = view_of(pattern, pixels, seen);
      if (view.size() > best.size()) best = std::move(view);
    }
    return best.size() < kMinPoints ? std::nullopt : std::optional<BoardView>(std::move(best));
  }
  std::string describe() const override {
    return "ChArUco board of " + size_text(board_) + ", " + board_.dictionary;
  }

 private:
  BoardView view_of(const Pattern& pattern, const cv::Mat& pixels, const SeenMarkers& seen) const {
    std::vector<cv::Point2f> corners;
    std::vector<int> corner_ids;
    cv::aruco::interpolateCornersCharuco(seen.corners, seen.ids, pixels, pattern, corners, corner_ids);
    BoardView view;
    for (size_t i = 0; i < corners.size(); ++i) {
      const auto number = static_cast<size_t>(corner_ids[i]);
      const auto side = shortest_side_beside(*pattern, number, corners[i], seen);
      if (!side) continue;
      // OpenCV takes the coordinates of cornerSubPix for another convention and adds half a pixel to x and y
      // (opencv_contrib #3024; opencv #25539, mended by #28380). Refined once more, corners are right with
      // and without that. The window keeps to where what the markers add is point-symmetric about the corner.
      constexpr double kWindow = 1.0 / 9;  // of a square
      constexpr int kMaxHalf = 5;
      const int half = std::min(static_cast<int>(kWindow * *side / board_.marker) + 1, kMaxHalf);
      const auto pixel = refine(pixels, corners[i], half);
      if (!pixel) continue;
      const cv::Point3f& point = pattern->chessboardCorners[number];
      view.on_board.emplace_back(point.x, point.y, 0);
      view.pixels.emplace_back(pixel->x, pixel->y);
    }
    return view;
  }

  /// The shortest side of the markers beside a corner [px]. Nothing if one of them was not seen, or if its
  /// continued diagonal misses the corner: an id was misread, or what was printed is another pattern, whose
  /// corners OpenCV misplaces (opencv_contrib #3301).
  std::optional<double> shortest_side_beside(const cv::aruco::CharucoBoard& pattern, size_t corner,
                                             const cv::Point2f& pixel, const SeenMarkers& seen) const {
    const auto beyond = static_cast<float>((1 - board_.marker) / (2 * board_.marker));  // in diagonals
    double shortest = std::numeric_limits<double>::max();
    for (size_t k = 0; k < pattern.nearestMarkerIdx[corner].size(); ++k) {
      const int id = pattern.ids[static_cast<size_t>(pattern.nearestMarkerIdx[corner][k])];
      const auto found = std::find(seen.ids.begin(), seen.ids.end(), id);
      if (found == seen.ids.end()) return std::nullopt;
      const auto& marker = seen.corners[static_cast<size_t>(found - seen.ids.begin())];
      const auto nearest = static_cast<size_t>(pattern.nearestMarkerCorners[corner][k]);
      const cv::Point2f diagonal = marker[nearest] - marker[(nearest + 2) % 4];
      constexpr double kSlack = 1.5;  // [px], of the marker's own corners
      if (cv::norm(marker[nearest] + beyond * diagonal - pixel) > kSlack + 0.25 * cv::norm(diagonal))
        return std::nullopt;
      for (size_t i = 0; i < 4; ++i) shortest = std::min(shortest, cv::norm(marker[i] - marker[(i + 1) % 4]));
    }
    return shortest;
  }

  BoardDescription board_;
  std::vector<Pattern> patterns_;
};

Status check_squares(const BoardDescription& board) {
  constexpr int kMaxSquares = 100;
  if (board.columns < 3 || board.rows < 3 || board.columns > kMaxSquares || board.rows > kMaxSquares) {
    return fail(ErrorCode::kUsage,
                "--squares " + std::to_string(board.columns) + "x" + std::to_string(board.rows) +
                    ": count the squares, columns x rows, at least 3x3: for example --squares 10x7");
  }
  if (!(board.square > 0)) return fail(ErrorCode::kUsage, "the side of a square must be greater than 0");
  return {};
}

Charuco::Pattern create_charuco(const BoardDescription& board, int rows,
                                const cv::Ptr<cv::aruco::Dictionary>& dictionary) {
  return cv::aruco::CharucoBoard::create(board.columns, rows, static_cast<float>(board.square),
                                         static_cast<float>(board.square * board.marker), dictionary);
}

Result<Charuco::Pattern> make_charuco(const BoardDescription& board) {
  const auto dictionary = dictionary_of(board.dictionary);
  if (!dictionary) return tl::unexpected(dictionary.error());
  if (!(board.marker > 0 && board.marker < 1)) {
    return fail(ErrorCode::kUsage, "--marker: the marker's side in squares, between 0 and 1");
  }
  const int markers = board.columns * board.rows / 2;
  if (markers > (*dictionary)->bytesList.rows) {
    return fail(ErrorCode::kUsage, "dictionary " + board.dictionary + " has " +
                                       std::to_string((*dictionary)->bytesList.rows) +
                                       " markers, the board needs " + std::to_string(markers));
  }
  return create_charuco(board, board.rows, *dictionary);
}

/// The patterns that a board of this description may have been printed with. Where the number of rows is
/// even, OpenCV before 4.6 (and calib.io) began with a white square in the upper left: a board of one more
/// row without its first.
Result<std::vector<Charuco::Pattern>> charuco_patterns(const BoardDescription& board) {
  const auto charuco = make_charuco(board);
  if (!charuco) return tl::unexpected(charuco.error());
  std::vector<Charuco::Pattern> patterns = {*charuco};
  if (board.rows % 2 == 0) {
    auto older = create_charuco(board, board.rows + 1, (*charuco)->dictionary);
    for (int& id : older->ids) id -= board.columns / 2;  // below 0 in the first row: never seen
    patterns.push_back(std::move(older));
  }
  return patterns;
}

}  // namespace

Result<std::unique_ptr<Board>> make_board(const BoardDescription& description) {
  if (description.kind == BoardDescription::Kind::kTags) {
    auto plan = read_tag_plan(description.tags);
    if (!plan) return tl::unexpected(plan.error());
    auto dictionary = dictionary_of(description.dictionary);
    if (!dictionary) return tl::unexpected(dictionary.error());
    return std::make_unique<TagBoard>(description.tags.string(), std::move(*plan), std::move(*dictionary));
  }
  if (auto status = check_squares(description); !status) return tl::unexpected(status.error());
  if (description.kind == BoardDescription::Kind::kChessboard)
    return std::make_unique<Chessboard>(description);
  auto patterns = charuco_patterns(description);
  if (!patterns) return tl::unexpected(patterns.error());
  return std::make_unique<Charuco>(description, std::move(*patterns));
}

Result<GrayImage> draw_board(const BoardDescription& description, int square_px) {
  if (description.kind == BoardDescription::Kind::kTags) {
    return fail(ErrorCode::kUsage, "tags are not drawn: print the image that their file describes");
  }
  if (auto status = check_squares(description); !status) return tl::unexpected(status.error());
  const cv::Size inside(description.columns * square_px, description.rows * square_px);
  cv::Mat image(inside.height + 2 * square_px, inside.width + 2 * square_px, CV_8U, cv::Scalar(255));
  cv::Mat board = image(cv::Rect(cv::Point(square_px, square_px), inside));
  if (description.kind == BoardDescription::Kind::kChessboard) {
    for (int y = 0; y < inside.height; ++y) {
      for (int x = 0; x < inside.width; ++x) {
        board.at<uint8_t>(y, x) = (x / square_px + y / square_px) % 2 == 0 ? 0 : 255;
      }
    }
  } else {
    const auto charuco = make_charuco(description);
    if (!charuco) return tl::unexpected(charuco.error());
    cv::Mat drawn;
    (*charuco)->draw(inside, drawn);
    drawn.copyTo(board);
  }
  return GrayImage(GrayView{image.data, image.cols, image.rows, static_cast<int>(image.step)});
}

}  // namespace cairn
