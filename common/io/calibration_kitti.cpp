// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>

#include "common/io/calibration_formats.h"

namespace cairn::calibration {
namespace {

constexpr size_t kProjection = 12;  ///< 3x4
constexpr size_t kMatrix = 9;       ///< 3x3

/// The lines `NAME: numbers`; others (calib_time) are left out.
std::map<std::string, std::vector<double>, std::less<>> rows_of(std::string_view content) {
  std::map<std::string, std::vector<double>, std::less<>> rows;
  for (const TextLine& line : data_lines(content)) {
    const size_t colon = line.text.find(':');
    if (colon == std::string_view::npos) continue;
    if (auto numbers = numbers_in(split_fields(line.text.substr(colon + 1))); numbers && !numbers->empty())
      rows.emplace(trim(line.text.substr(0, colon)), std::move(*numbers));
  }
  return rows;
}

bool is_projection(const std::string& name, size_t numbers) {
  const bool named =
      name.starts_with("P_rect_") || (name.size() == 2 && name[0] == 'P' && name[1] >= '0' && name[1] <= '9');
  return named && numbers == kProjection;
}

bool is_unrectified(const std::string& name, size_t numbers) {
  return name.starts_with("K_") && numbers == kMatrix;
}

/// A camera of the file under its name. Without a size in the file (calib.txt) it is the source's.
struct Candidate {
  std::string name;
  CameraParameters parameters;
};

std::vector<Candidate> candidates_of(const File& file) {
  const auto rows = rows_of(file.content);
  const auto row = [&](const std::string& name) {
    const auto at = rows.find(name);
    return at == rows.end() ? std::vector<double>() : at->second;
  };
  std::vector<Candidate> candidates;
  for (const auto& [name, m] : rows) {
    const bool rectified = is_projection(name, m.size());
    if (!rectified && !is_unrectified(name, m.size())) continue;
    const std::string number = name.substr(name.size() - 2);
    const auto sides = row((rectified ? "S_rect_" : "S_") + number);
    CameraParameters linear{CameraModel::kPinholeRadtan, 0, 0, {}};
    if (sides.size() == 2) {
      linear.width = side_from_number(sides[0]);
      linear.height = side_from_number(sides[1]);
    } else if (file.image_size) {
      linear.width = file.image_size->width;
      linear.height = file.image_size->height;
    }
    linear.values = rectified ? std::vector{m[0], m[5], m[2], m[6]} : std::vector{m[0], m[4], m[2], m[5]};
    const auto camera = with_distortion(std::move(linear), Distortion::kRadtan,
                                        rectified ? std::vector<double>() : row("D_" + number));
    if (camera) candidates.push_back({name, *camera});
  }
  return candidates;
}

/// Rectified cameras share one matrix, and then it does not matter which; images of another size are none
/// of theirs.
void leave_out_others(const File& file, std::vector<Candidate>* candidates) {
  if (!file.camera.empty()) return;
  std::erase_if(*candidates, [&](const Candidate& c) {
    return file.image_size && ImageSize{c.parameters.width, c.parameters.height} != *file.image_size;
  });
  const bool alike = std::all_of(candidates->begin(), candidates->end(), [&](const Candidate& c) {
    return c.parameters == candidates->front().parameters;
  });
  if (alike && !candidates->empty()) candidates->erase(candidates->begin() + 1, candidates->end());
}

}  // namespace

bool looks_like_kitti(std::string_view content) {
  const auto rows = rows_of(content);
  return std::any_of(rows.begin(), rows.end(), [](const auto& row) {
    return is_projection(row.first, row.second.size()) || is_unrectified(row.first, row.second.size());
  });
}

Result<CameraParameters> parse_kitti(const File& file) {
  auto candidates = candidates_of(file);
  leave_out_others(file, &candidates);
  if (candidates.empty()) {
    return wrong(file.path.string() +
                 ": KITTI's calibration of images of another size; write the line `width height fx fy cx cy` "
                 "of your images into camera.txt");
  }
  std::vector<std::string> names;
  for (const Candidate& c : candidates) names.push_back(c.name);
  const auto name = choose_camera(file, names);
  if (!name) return tl::unexpected(name.error());
  const auto& chosen =
      candidates[static_cast<size_t>(std::find(names.begin(), names.end(), *name) - names.begin())];
  if (chosen.parameters.width == 0 || chosen.parameters.height == 0) {
    return wrong(file.path.string() +
                 ": KITTI's calibration has no image size, and the source does not tell its size; write one "
                 "line `width height fx fy cx cy` into camera.txt");
  }
  return chosen.parameters;
}

}  // namespace cairn::calibration
