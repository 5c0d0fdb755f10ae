// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "client/app/calibrate/board.h"
#include "client/app/calibrate/verdict.h"
#include "client/app/parse_exit.h"
#include "client/capture/frame_source.h"
#include "common/base/log.h"

namespace cairn {

/// The words of `cairn-track calibrate`, checked.
struct CalibrateOptions {
  std::string source;
  BoardDescription board;
  CameraModel model = CameraModel::kPinholeRadtan;
  std::filesystem::path out;
  std::optional<std::filesystem::path> draw;  ///< only draw the board there
  int verbosity = 0;                          ///< as make_logger()
};

/// `arguments` after the word `calibrate`.
[[nodiscard]] std::variant<CalibrateOptions, ParseExit> parse_calibrate_options(
    std::vector<std::string> arguments);

struct CalibrateReport {
  BoardCalibration calibration;
  Verdict verdict;
  int images = 0;  ///< looked at
  int found = 0;   ///< with the board
};

/// Looks for the board in the images of a source (five a second of its own time), picks views, calibrates
/// and judges. Ends at the source's end, when `stop_requested`, or with a live camera as soon as the result
/// is good. Errors: kDegenerate (too few views; says what was seen), what the source gives first if it gives
/// no image at all, and kDamaged when images differ in size.
[[nodiscard]] Result<CalibrateReport> calibrate_from(FrameSource& source, const Board& board,
                                                     CameraModel model, const Logger& log,
                                                     const std::function<bool()>& stop_requested);

/// The command; its exit code: 0 for a good or usable calibration, which is written as Kalibr yaml, 1 for a
/// poor one, which is not. That the file cannot be written is told before the source is opened; if it comes
/// about later, the yaml goes to stdout.
[[nodiscard]] int run_calibrate(const CalibrateOptions& options, const Logger& log,
                                const std::function<bool()>& stop_requested);

}  // namespace cairn
