// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "common/io/calibration_formats.h"
#include "common/io/text.h"

namespace cairn::calibration {
namespace {

constexpr size_t kPtamValues = 5;
constexpr std::string_view kPtamKey = "Camera.Parameters";

/// Between blanks, a comma before one left out: any other comma may be a decimal one, and half of the numbers
/// would be those behind it.
std::vector<std::string_view> words_of(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r";
  std::vector<std::string_view> words;
  for (text = trim(text); !text.empty(); text = trim(text)) {
    const size_t end = std::min(text.find_first_of(kBlanks), text.size());
    const auto word = text.substr(0, end);
    text.remove_prefix(end);
    words.push_back(word.ends_with(',') && !text.empty() ? word.substr(0, word.size() - 1) : word);
  }
  return words;
}

/// The line's numbers; a comment may follow them. PTAM's key, '=' and brackets are left out.
Result<std::vector<double>> numbers_of(const File& file, const TextLine& line) {
  std::string text(line.text.substr(0, line.text.find_first_of("#;")));
  if (text.starts_with(kPtamKey)) {
    text.erase(0, kPtamKey.size());
    for (char& c : text) {
      if (c == '=' || c == '[' || c == ']') c = ' ';
    }
  }
  std::vector<double> numbers;
  for (const auto word : words_of(text)) {
    const auto number = parse_number(word);
    if (!number) {
      const bool has_comma = word.find(',') != std::string_view::npos;
      return wrong(at_line(
          file.path, line.number,
          in_quotes(word) + " is not a number; " +
              (has_comma ? "write a decimal point, and blanks between numbers" : std::string(kFormats))));
    }
    numbers.push_back(*number);
  }
  return numbers;
}

/// PTAM's five numbers, told from pixels by their size: no lens has a focal length of 20 image sides.
bool counts_in_image_sides(const std::vector<double>& v) {
  constexpr double kMaxSides = 20;
  return v.size() == kPtamValues &&
         std::all_of(v.begin(), v.end(), [](double x) { return std::abs(x) < kMaxSides; });
}

Result<CameraParameters> from_ptam(const File& file, const std::vector<double>& v) {
  if (!file.image_size) {
    return wrong(file.path.string() +
                 ": five numbers as in PTAM's camera.cfg count in image sizes, and the source does not tell "
                 "its size; write the calibration as one line `width height fx fy cx cy [k1 k2 p1 p2]` or as "
                 "Kalibr yaml");
  }
  auto parameters = in_pixels(*file.image_size, v);
  parameters.model = CameraModel::kFov;
  parameters.values.push_back(v[4]);
  return parameters;
}

}  // namespace

Result<CameraParameters> parse_text(const File& file) {
  if (!file.camera.empty()) return names_no_camera(file);
  const auto lines = table_rows(file.content);
  if (lines.empty()) return wrong(file.path.string() + ": no calibration in it; " + std::string(kFormats));
  const auto ptam = std::find_if(lines.begin(), lines.end(),
                                 [](const TextLine& line) { return line.text.starts_with(kPtamKey); });
  if (ptam == lines.end() && lines.size() > 1) {
    return wrong(at_line(file.path, lines[1].number, "a second line of data; " + std::string(kFormats)));
  }
  const TextLine& line = ptam == lines.end() ? lines.front() : *ptam;
  const size_t number = line.number;
  const auto numbers = numbers_of(file, line);
  if (!numbers) return tl::unexpected(numbers.error());
  if (counts_in_image_sides(*numbers)) return from_ptam(file, *numbers);
  if (numbers->size() != 6 && numbers->size() != 10 && numbers->size() != 11) {
    return wrong(at_line(file.path, number,
                         std::to_string(numbers->size()) +
                             " numbers, not 6, 10 or 11 (PTAM's five are in image sizes, not pixels); " +
                             std::string(kFormats)));
  }
  CameraParameters parameters;
  parameters.width = side_from_number((*numbers)[0]);
  parameters.height = side_from_number((*numbers)[1]);
  parameters.values.assign(numbers->begin() + 2, numbers->end());
  parameters.values.resize(kRadtanValues, 0.0);
  if (parameters.width == 0 || parameters.height == 0) {
    return wrong(at_line(file.path, number, "image width and height must be positive whole numbers"));
  }
  return parameters;
}

}  // namespace cairn::calibration
