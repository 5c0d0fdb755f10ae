// SPDX-License-Identifier: Apache-2.0
#include "client/app/calibrate/board.h"

#include <nlohmann/json.hpp>

#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <opencv2/aruco.hpp>
#include <opencv2/aruco/charuco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <string_view>
#include <utility>

#include "common/io/text.h"

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

class Chessboard final : public Board {
 public:
  explicit Chessboard(const BoardDescription& description) : board_(description) {}

  std::optional<BoardView> find(const GrayView& picture) const override {
    std::vector<cv::Point2f> corners;
    const cv::Size inner(board_.columns - 1, board_.rows - 1);
    if (!cv::findChessboardCornersSB(as_mat(picture), inner, corners, cv::CALIB_CB_NORMALIZE_IMAGE))
      return std::nullopt;
    BoardView view;
    for (size_t i = 0; i < corners.size(); ++i) {
      const auto number = static_cast<int>(i);
      const Eigen::Vector2i crossing(number % inner.width, number / inner.width);
      view.on_board.emplace_back(crossing.x() * board_.square, crossing.y() * board_.square, 0);
      view.pixels.emplace_back(corners[i].x, corners[i].y);
    }
    return view;
  }
  std::string describe() const override { return "chessboard of " + size_text(board_); }

 private:
  BoardDescription board_;
};

class Charuco final : public Board {
 public:
  Charuco(const BoardDescription& description, cv::Ptr<cv::aruco::CharucoBoard> charuco)
      : board_(description), charuco_(std::move(charuco)) {}

  std::optional<BoardView> find(const GrayView& picture) const override {
    const cv::Mat pixels = as_mat(picture);
    std::vector<std::vector<cv::Point2f>> markers;
    std::vector<int> ids;
    cv::aruco::detectMarkers(pixels, charuco_->dictionary, markers, ids);
    if (ids.empty()) return std::nullopt;
    std::vector<cv::Point2f> corners;
    std::vector<int> corner_ids;
    cv::aruco::interpolateCornersCharuco(markers, ids, pixels, charuco_, corners, corner_ids);
    if (corners.size() < kMinPoints) return std::nullopt;
    BoardView view;
    for (size_t i = 0; i < corners.size(); ++i) {
      const cv::Point3f& point = charuco_->chessboardCorners[static_cast<size_t>(corner_ids[i])];
      view.on_board.emplace_back(point.x, point.y, 0);
      view.pixels.emplace_back(corners[i].x, corners[i].y);
    }
    return view;
  }
  std::string describe() const override {
    return "ChArUco board of " + size_text(board_) + ", " + board_.dictionary;
  }

 private:
  BoardDescription board_;
  cv::Ptr<cv::aruco::CharucoBoard> charuco_;
};

/// Single tags anywhere on a plane.
class TagBoard final : public Board {
 public:
  using Corners = std::array<Eigen::Vector3d, 4>;
  TagBoard(std::string description, std::map<int, Corners> tags, cv::Ptr<cv::aruco::Dictionary> dictionary)
      : description_(std::move(description)), tags_(std::move(tags)), dictionary_(std::move(dictionary)) {}

  std::optional<BoardView> find(const GrayView& picture) const override {
    const auto parameters = cv::aruco::DetectorParameters::create();
    parameters->cornerRefinementMethod = cv::aruco::CORNER_REFINE_CONTOUR;
    std::vector<std::vector<cv::Point2f>> corners;
    std::vector<int> ids;
    cv::aruco::detectMarkers(as_mat(picture), dictionary_, corners, ids, parameters);
    BoardView view;
    for (size_t i = 0; i < ids.size(); ++i) {
      const auto tag = tags_.find(ids[i]);
      if (tag == tags_.end()) continue;
      for (size_t k = 0; k < 4; ++k) {
        view.on_board.push_back(tag->second[k]);
        view.pixels.emplace_back(corners[i][k].x, corners[i][k].y);
      }
    }
    return view.size() < kMinPoints ? std::nullopt : std::optional<BoardView>(std::move(view));
  }
  std::string describe() const override { return description_; }

 private:
  std::string description_;
  std::map<int, Corners> tags_;
  cv::Ptr<cv::aruco::Dictionary> dictionary_;
};

Result<std::map<int, TagBoard::Corners>> read_tags(const std::filesystem::path& path) {
  const auto content = read_file(path);
  if (!content) return tl::unexpected(content.error());
  const auto wrong = [&](const std::string& what) {
    return fail(ErrorCode::kConfiguration,
                path.string() + ": " + what + "; expected {\"ID\": [[x, y, 0], three more corners], ...}");
  };
  const auto json = nlohmann::json::parse(*content, nullptr, false);
  if (!json.is_object()) return wrong("not a JSON object");
  std::map<int, TagBoard::Corners> tags;
  for (const auto& [key, value] : json.items()) {
    int id = 0;
    const auto [end, error] = std::from_chars(key.data(), key.data() + key.size(), id);
    if (error != std::errc() || end != key.data() + key.size()) continue;  // notes on the paper and the like
    TagBoard::Corners corners;
    if (!value.is_array() || value.size() != corners.size())
      return wrong("tag " + key + " has not four corners");
    for (size_t k = 0; k < corners.size(); ++k) {
      const auto& corner = value[k];
      if (!corner.is_array() || corner.size() < 2 || !corner[0].is_number() || !corner[1].is_number()) {
        return wrong("tag " + key + ": a corner is not a list of numbers");
      }
      corners[k] = {corner[0].get<double>(), corner[1].get<double>(), 0};
      constexpr double kFlat = 1e-6;
      if (corner.size() > 2 && !(corner[2].is_number() && std::abs(corner[2].get<double>()) < kFlat)) {
        return wrong("tag " + key + " is not in the plane z = 0");
      }
    }
    tags.emplace(id, corners);
  }
  if (tags.empty()) return wrong("no tag in it");
  return tags;
}

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

Result<cv::Ptr<cv::aruco::CharucoBoard>> make_charuco(const BoardDescription& board) {
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
  return cv::aruco::CharucoBoard::create(board.columns, board.rows, static_cast<float>(board.square),
                                         static_cast<float>(board.square * board.marker), *dictionary);
}

}  // namespace

Result<std::unique_ptr<Board>> make_board(const BoardDescription& description) {
  if (description.kind == BoardDescription::Kind::kTags) {
    auto tags = read_tags(description.tags);
    if (!tags) return tl::unexpected(tags.error());
    auto dictionary = dictionary_of(description.dictionary);
    if (!dictionary) return tl::unexpected(dictionary.error());
    return std::make_unique<TagBoard>(std::to_string(tags->size()) + " tags of " + description.tags.string(),
                                      std::move(*tags), std::move(*dictionary));
  }
  if (auto status = check_squares(description); !status) return tl::unexpected(status.error());
  if (description.kind == BoardDescription::Kind::kChessboard)
    return std::make_unique<Chessboard>(description);
  auto charuco = make_charuco(description);
  if (!charuco) return tl::unexpected(charuco.error());
  return std::make_unique<Charuco>(description, std::move(*charuco));
}

Result<GrayImage> draw_board(const BoardDescription& description, int square_px) {
  if (description.kind == BoardDescription::Kind::kTags) {
    return fail(ErrorCode::kUsage, "tags are not drawn: print the picture that their file describes");
  }
  if (auto status = check_squares(description); !status) return tl::unexpected(status.error());
  const cv::Size inside(description.columns * square_px, description.rows * square_px);
  cv::Mat picture(inside.height + 2 * square_px, inside.width + 2 * square_px, CV_8U, cv::Scalar(255));
  cv::Mat board = picture(cv::Rect(cv::Point(square_px, square_px), inside));
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
  return GrayImage(GrayView{picture.data, picture.cols, picture.rows, static_cast<int>(picture.step)});
}

}  // namespace cairn
