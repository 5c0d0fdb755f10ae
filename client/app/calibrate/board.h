// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "client/app/calibrate/solver.h"
#include "common/image/image.h"

namespace cairn {

/// The board that a person has printed.
struct BoardDescription {
  enum class Kind { kChessboard, kCharuco, kTags };
  Kind kind = Kind::kChessboard;
  int columns = 0;                    ///< squares, counted across
  int rows = 0;                       ///< squares, counted down
  double square = 1;                  ///< side [any unit]
  double marker = 0.75;               ///< side of ChArUco's markers, in squares
  std::string dictionary = "4x4_50";  ///< of the markers: NxN_COUNT or apriltag_NAME
  std::filesystem::path tags;         ///< kTags: as read_tag_plan()
};

/// Finds a board in images. Used by one thread at a time.
class Board {
 public:
  virtual ~Board() = default;
  /// The points of the board seen in an image, with sub-pixel positions; nothing if it is not seen or too
  /// little of it.
  [[nodiscard]] virtual std::optional<BoardView> find(const GrayView& image) const = 0;
  /// The board in words, for a person.
  [[nodiscard]] virtual std::string describe() const = 0;
};

/// Makes the board of a description. Errors: kUsage (counts, sizes, unknown dictionary; says which there
/// are), kNotFound, kConfiguration (the tag file).
[[nodiscard]] Result<std::unique_ptr<Board>> make_board(const BoardDescription& description);

/// The board as an image to print, `square_px` to a square, with a margin of one square; kUsage for tags,
/// which have an image already.
[[nodiscard]] Result<GrayImage> draw_board(const BoardDescription& description, int square_px);

}  // namespace cairn
