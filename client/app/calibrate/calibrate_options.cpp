// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <map>
#include <tuple>
#include <utility>

#include "client/app/calibrate/calibrate.h"
#include "common/base/unknown_word.h"
#include "common/base/version.h"

namespace cairn {
namespace {

constexpr int kUsageExit = 2;
constexpr const char* kDescription =
    "Calibrates a camera from a printed board and writes Kalibr yaml for --calibration.\n"
    "Move the board through the whole image, near and far, tilted to each side; hold it still for a "
    "moment.";
constexpr const char* kFooter =
    "ChArUco boards: as --draw draws them (OpenCV 4.6 and later, upper left square black). With an even "
    "number of rows, those of OpenCV before 4.6 and of calib.io (white) are recognized too.\n"
    "Exit codes: 0 good or usable (written), 1 poor (not written), else as cairn-track\n\n"
    "Examples:\n"
    "  cairn-track calibrate --board charuco --squares 10x7 --draw board.png\n"
    "  cairn-track calibrate --source v4l2:/dev/video0?size=640x480 --board charuco --squares 10x7 --out "
    "camera.yaml\n"
    "  cairn-track calibrate --source video:board.mp4 --board chessboard --squares 9x6 --model kb4 --out "
    "camera.yaml";

const std::map<std::string, BoardDescription::Kind> kKinds = {
    {"chessboard", BoardDescription::Kind::kChessboard},
    {"charuco", BoardDescription::Kind::kCharuco},
    {"tags", BoardDescription::Kind::kTags}};
const std::map<std::string, CameraModel> kModels = {{"radtan", CameraModel::kPinholeRadtan},
                                                    {"kb4", CameraModel::kKannalaBrandt}};

struct Words {
  CalibrateOptions options;
  std::string board;
  std::string squares;
  std::string model = "radtan";
  std::string out;
  std::string draw;
  std::string tags;
  bool verbose = false;
  bool quiet = false;
};

void declare(CLI::App& app, Words& words) {
  auto& board = words.options.board;
  app.add_option("--source", words.options.source, "where images come from, as for cairn-track")
      ->type_name("URI");
  app.add_option("--board", words.board, "chessboard, charuco, or tags on a plane")
      ->required()
      ->check(CLI::IsMember({"chessboard", "charuco", "tags"}));
  app.add_option("--squares", words.squares, "squares of the board, across x down")->type_name("COLSxROWS");
  app.add_option("--marker", board.marker, "side of a ChArUco marker in squares")->capture_default_str();
  app.add_option("--dictionary", board.dictionary, "of the markers [4x4_50; tags: apriltag_36h11]")
      ->type_name("NAME");
  app.add_option("--tags", words.tags,
                 "JSON: tag id -> its four corners on the plane; or the yaml of Kalibr's aprilgrid")
      ->type_name("FILE");
  app.add_option("--model", words.model, "radtan: most lenses; kb4: wide and fisheye lenses")
      ->check(CLI::IsMember({"radtan", "kb4"}))
      ->capture_default_str();
  app.add_option("--out", words.out, "the Kalibr yaml to write")->type_name("FILE");
  app.add_option("--draw", words.draw, "only draws the board to print (.png)")->type_name("FILE");
  app.add_flag("-v,--verbose", words.verbose, "more words");
  app.add_flag("-q,--quiet", words.quiet, "warnings only");
  app.set_version_flag("--version", "cairn-track " + std::string(version()));
}

ParseExit usage(const std::string& message) {
  return {kUsageExit,
          "cairn-track calibrate: " + message + "\ncairn-track calibrate --help lists all options\n"};
}

/// "10x7"; 0x0 if it is not that.
std::pair<int, int> parse_squares(const std::string& text) {
  int columns = 0;
  int rows = 0;
  char after = 0;
  if (std::sscanf(text.c_str(), "%3dx%3d%c", &columns, &rows, &after) != 2) return {0, 0};
  return {columns, rows};
}

std::variant<CalibrateOptions, ParseExit> translate(Words words, bool dictionary_given) {
  auto& options = words.options;
  auto& board = options.board;
  board.kind = kKinds.at(words.board);
  options.model = kModels.at(words.model);
  options.out = words.out;
  options.verbosity = (words.verbose ? 1 : 0) - (words.quiet ? 1 : 0);
  if (board.kind == BoardDescription::Kind::kTags) {
    if (words.tags.empty()) return usage("--board tags needs --tags FILE");
    if (!dictionary_given) board.dictionary = "apriltag_36h11";
    board.tags = words.tags;
  } else {
    std::tie(board.columns, board.rows) = parse_squares(words.squares);
    if (board.columns < 3 || board.rows < 3) {
      return usage("--squares '" + words.squares +
                   "': count the squares across and down, for example --squares 10x7");
    }
  }
  if (!words.draw.empty()) {
    options.draw = words.draw;
    return std::move(options);
  }
  if (options.source.empty()) return usage("--source is required");
  if (options.out.empty()) return usage("--out is required");
  return std::move(options);
}

}  // namespace

std::variant<CalibrateOptions, ParseExit> parse_calibrate_options(std::vector<std::string> arguments) {
  CLI::App app(kDescription, "cairn-track calibrate");
  app.footer(kFooter);
  Words words;
  declare(app, words);
  std::reverse(arguments.begin(), arguments.end());  // CLI11 takes them from the back
  try {
    app.parse(std::move(arguments));
  } catch (const CLI::CallForHelp&) {
    return ParseExit{0, app.help()};
  } catch (const CLI::CallForVersion& version) {
    return ParseExit{0, std::string(version.what()) + "\n"};
  } catch (const CLI::ParseError& error) {
    return usage(unknown_word(app, error).value_or(error.what()));
  }
  const bool dictionary_given = app.count("--dictionary") > 0;
  return translate(std::move(words), dictionary_given);
}

}  // namespace cairn
