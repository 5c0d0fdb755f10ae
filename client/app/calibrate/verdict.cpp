// SPDX-License-Identifier: Apache-2.0
#include "client/app/calibrate/verdict.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace cairn {
namespace {

constexpr int kColumns = 6;
constexpr int kRows = 4;

struct Limits {
  double rms;  ///< in image widths
  double focal_sigma;
  double coverage;
  int views;
};
constexpr Limits kGoodLimits{0.0008, 0.003, 0.8, 10};
constexpr Limits kUsableLimits{0.002, 0.015, 0.5, 5};

using Cells = std::array<std::array<bool, kColumns>, kRows>;

Cells covered_cells(const BoardCalibration& calibration, const std::vector<BoardView>& views) {
  Cells cells{};
  for (size_t v = 0; v < views.size(); ++v) {
    for (size_t i = 0; i < views[v].size(); ++i) {
      if (!calibration.views[v].inliers[i]) continue;
      const auto cell = [](double at, int side, int count) {
        return static_cast<size_t>(std::clamp(static_cast<int>((at + 0.5) * count / side), 0, count - 1));
      };
      cells[cell(views[v].pixels[i].y(), calibration.parameters.height, kRows)]
           [cell(views[v].pixels[i].x(), calibration.parameters.width, kColumns)] = true;
    }
  }
  return cells;
}

/// "upper left, right": the sixths of the image, three across and two down, half of whose cells or more
/// were never seen.
std::string missing_places(const Cells& cells) {
  constexpr std::array<const char*, 3> kAcross = {"left", "middle", "right"};
  std::string places;
  for (size_t down = 0; down < 2; ++down) {
    for (size_t across = 0; across < 3; ++across) {
      int missing = 0;
      for (size_t y = 2 * down; y < 2 * down + 2; ++y) {
        for (size_t x = 2 * across; x < 2 * across + 2; ++x) missing += cells[y][x] ? 0 : 1;
      }
      if (missing < 2) continue;
      places += std::string(places.empty() ? "" : ", ") + (down == 0 ? "upper " : "lower ") + kAcross[across];
    }
  }
  return places;
}

bool within(const Verdict& verdict, double rms, const Limits& limits) {
  return rms <= limits.rms && verdict.focal_sigma <= limits.focal_sigma &&
         verdict.coverage >= limits.coverage && verdict.views >= limits.views;
}

std::vector<std::string> advice_for(const Verdict& verdict, double rms, const Cells& cells) {
  std::vector<std::string> advice;
  if (rms > kGoodLimits.rms) {
    advice.emplace_back(
        "the points do not fit well: is the board flat and stiff, are --squares and --board what was "
        "printed, was it held still? A wide lens may need --model kb4");
  }
  if (verdict.coverage < kGoodLimits.coverage) {
    const auto places = missing_places(cells);
    advice.push_back("take more views with the board " +
                     (places.empty() ? "at the rim of the image" : "in the " + places + " of the image"));
  }
  constexpr double kTilt = 25 * std::numbers::pi / 180;
  if (verdict.focal_sigma > kGoodLimits.focal_sigma || verdict.largest_tilt < kTilt) {
    advice.emplace_back("take more views with the board near and tilted by 30 to 45 degrees, to each side");
  }
  if (verdict.views < kGoodLimits.views) {
    advice.push_back("take more views: " + std::to_string(verdict.views) + " different sharp ones count, " +
                     std::to_string(kGoodLimits.views) + " and more are good");
  }
  return advice;
}

}  // namespace

Verdict judge(const BoardCalibration& calibration, const std::vector<BoardView>& views) {
  Verdict verdict;
  for (const auto& view : calibration.views) {
    if (std::find(view.inliers.begin(), view.inliers.end(), true) == view.inliers.end()) continue;
    ++verdict.views;
    const double cosine = std::abs(view.camera_from_board.rotation_matrix()(2, 2));
    verdict.largest_tilt = std::max(verdict.largest_tilt, std::acos(std::min(1.0, cosine)));
  }
  const Cells cells = covered_cells(calibration, views);
  int covered = 0;
  for (const auto& row : cells) covered += static_cast<int>(std::count(row.begin(), row.end(), true));
  verdict.coverage = covered / static_cast<double>(kColumns * kRows);
  const auto& values = calibration.parameters.values;
  verdict.focal_sigma = std::max(calibration.sigma[0] / values[0], calibration.sigma[1] / values[1]);
  const double rms = calibration.rms / calibration.parameters.width;
  if (within(verdict, rms, kGoodLimits)) {
    verdict.grade = Grade::kGood;
    return verdict;
  }
  verdict.grade = within(verdict, rms, kUsableLimits) ? Grade::kUsable : Grade::kPoor;
  verdict.advice = advice_for(verdict, rms, cells);
  return verdict;
}

std::string_view name_of(Grade grade) {
  switch (grade) {
    case Grade::kGood:
      return "good";
    case Grade::kUsable:
      return "usable";
    case Grade::kPoor:
      return "poor";
  }
  return "";
}

}  // namespace cairn
