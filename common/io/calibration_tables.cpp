// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cctype>
#include <span>

#include "common/io/calibration_formats.h"

// COLMAP's cameras.txt, and the four lines of LSD-SLAM and DSO.
namespace cairn::calibration {
namespace {

using Fields = std::vector<std::string_view>;

// ---- COLMAP

/// One of COLMAP's models, with its parameters as one letter each: f both focal lengths, x and y, c and d the
/// centre, the digits k1 to k6, p and q the tangential, w the angle of FOV.
struct ColmapModel {
  std::string_view name;
  Distortion distortion;
  std::string_view parameters;
};
constexpr ColmapModel kColmapModels[] = {
    {"SIMPLE_PINHOLE", Distortion::kNone, "fcd"},
    {"PINHOLE", Distortion::kNone, "xycd"},
    {"SIMPLE_RADIAL", Distortion::kRadtan, "fcd1"},
    {"RADIAL", Distortion::kRadtan, "fcd12"},
    {"OPENCV", Distortion::kRadtan, "xycd12pq"},
    {"FULL_OPENCV", Distortion::kRadtan, "xycd12pq3456"},
    {"OPENCV_FISHEYE", Distortion::kEquidistant, "xycd1234"},
    {"SIMPLE_RADIAL_FISHEYE", Distortion::kEquidistant, "fcd1"},
    {"RADIAL_FISHEYE", Distortion::kEquidistant, "fcd12"},
    {"FOV", Distortion::kFov, "xycdw"},
};

/// `ID MODEL WIDTH HEIGHT ...`
bool is_colmap_row(const Fields& fields) {
  return fields.size() >= 7 && fields[0].find_first_not_of("0123456789") == std::string_view::npos &&
         std::isupper(static_cast<unsigned char>(fields[1].front())) != 0 &&
         fields[1].find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_") == std::string_view::npos;
}

/// COLMAP's pixel (0,0) is the corner of the first pixel.
Result<CameraParameters> from_colmap(const ColmapModel& model, ImageSize size, std::span<const double> v) {
  constexpr double kCornerToCentre = 0.5;
  CameraParameters linear{CameraModel::kPinholeRadtan, size.width, size.height, {}};
  std::vector<double> coefficients;
  for (size_t i = 0; i < v.size(); ++i) {
    switch (model.parameters[i]) {
      case 'f':
        linear.values.insert(linear.values.end(), {v[i], v[i]});
        break;
      case 'x':
      case 'y':
        linear.values.push_back(v[i]);
        break;
      case 'c':
      case 'd':
        linear.values.push_back(v[i] - kCornerToCentre);
        break;
      default:
        coefficients.push_back(v[i]);
    }
  }
  if (model.distortion == Distortion::kEquidistant) coefficients.resize(4, 0.0);
  return with_distortion(std::move(linear), model.distortion, std::move(coefficients));
}

Result<CameraParameters> parse_colmap_row(const Fields& fields) {
  const auto* const model = std::find_if(std::begin(kColmapModels), std::end(kColmapModels),
                                         [&](const ColmapModel& m) { return m.name == fields[1]; });
  if (model == std::end(kColmapModels)) {
    return wrong("COLMAP's model " + in_quotes(fields[1]) +
                 " is not read; OPENCV, OPENCV_FISHEYE and the simpler ones are");
  }
  const auto numbers = numbers_in({fields.begin() + 2, fields.end()});
  if (!numbers || numbers->size() != 2 + model->parameters.size()) {
    return wrong("expected width, height and " + std::to_string(model->parameters.size()) +
                 " numbers after " + std::string(model->name));
  }
  const ImageSize size{side_from_number((*numbers)[0]), side_from_number((*numbers)[1])};
  if (size.width == 0 || size.height == 0) return wrong("width and height must be positive whole numbers");
  return from_colmap(*model, size, std::span(*numbers).subspan(2));
}

// ---- LSD-SLAM and DSO

struct DsoModel {
  std::string_view word;  ///< that the first line may begin with
  Distortion distortion;
  size_t numbers;
};
constexpr DsoModel kDsoModels[] = {
    {"", Distortion::kRadtan, 8},
    {"", Distortion::kFov, 5},
    {"RadTan", Distortion::kRadtan, 8},
    {"FOV", Distortion::kFov, 5},
    {"Pinhole", Distortion::kFov, 5},
    {"EquiDistant", Distortion::kEquidistant, 8},
    {"KannalaBrandt", Distortion::kEquidistant, 8},
};

/// The model of a first line; null where it is none.
const DsoModel* dso_model(const Fields& fields) {
  const bool has_word = std::isalpha(static_cast<unsigned char>(fields.front().front())) != 0;
  const std::string_view word = has_word ? fields.front() : std::string_view();
  const size_t numbers = fields.size() - (has_word ? 1 : 0);
  const auto* const at = std::find_if(std::begin(kDsoModels), std::end(kDsoModels), [&](const DsoModel& m) {
    return m.word == word && m.numbers == numbers;
  });
  return at == std::end(kDsoModels) ? nullptr : at;
}

}  // namespace

bool looks_like_colmap(std::string_view content) {
  const auto lines = data_lines(content);
  return !lines.empty() && is_colmap_row(split_fields(lines.front().text));
}

Result<CameraParameters> parse_colmap(const File& file) {
  const auto lines = data_lines(file.content);
  std::vector<std::string> ids;
  for (const TextLine& line : lines) ids.emplace_back(split_fields(line.text).front());
  const auto id = choose_camera(file, ids);
  if (!id) return tl::unexpected(id.error());
  const TextLine& line = lines[static_cast<size_t>(std::find(ids.begin(), ids.end(), *id) - ids.begin())];
  const auto fields = split_fields(line.text);
  if (!is_colmap_row(fields)) {
    return wrong(at_line(file.path, line.number, "expected COLMAP's `ID MODEL WIDTH HEIGHT PARAMETERS`"));
  }
  auto parameters = parse_colmap_row(fields);
  if (!parameters) return wrong(at_line(file.path, line.number, parameters.error().message));
  return parameters;
}

bool looks_like_dso(std::string_view content) {
  const auto lines = data_lines(content);
  return lines.size() >= 2 && dso_model(split_fields(lines[0].text)) != nullptr &&
         split_fields(lines[1].text).size() == 2;
}

Result<CameraParameters> parse_dso(const File& file) {
  if (!file.camera.empty()) return names_no_camera(file);
  const auto lines = data_lines(file.content);
  auto fields = split_fields(lines[0].text);
  const DsoModel& model = *dso_model(fields);
  if (fields.size() > model.numbers) fields.erase(fields.begin());
  const auto v = numbers_in(fields);
  if (!v)
    return wrong(
        at_line(file.path, lines[0].number, "expected numbers, as in calibrations of LSD-SLAM and DSO"));
  const auto sides = numbers_in(split_fields(lines[1].text));
  const ImageSize size =
      sides ? ImageSize{side_from_number((*sides)[0]), side_from_number((*sides)[1])} : ImageSize{};
  if (size.width == 0 || size.height == 0) {
    return wrong(at_line(file.path, lines[1].number,
                         "expected width and height, as in calibrations of LSD-SLAM and DSO"));
  }
  // As DSO tells them apart: a principal point within 1 counts in image sides.
  const bool counts_in_sides = (*v)[2] < 1 && (*v)[3] < 1;
  auto linear = counts_in_sides
                    ? in_pixels(size, *v)
                    : CameraParameters{
                          CameraModel::kPinholeRadtan, size.width, size.height, {v->begin(), v->begin() + 4}};
  const Distortion distortion =
      model.distortion == Distortion::kFov && (*v)[4] == 0 ? Distortion::kNone : model.distortion;
  auto parameters = with_distortion(std::move(linear), distortion, {v->begin() + 4, v->end()});
  if (!parameters) return wrong(at_line(file.path, lines[0].number, parameters.error().message));
  return parameters;
}

}  // namespace cairn::calibration
