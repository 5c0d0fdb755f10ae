// SPDX-License-Identifier: Apache-2.0
#include "client/app/calibrate/tag_file.h"

#include <yaml-cpp/yaml.h>

#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "common/io/text.h"

namespace cairn {
namespace {

tl::unexpected<Error> wrong(const std::filesystem::path& path, const std::string& what,
                            const std::string& expected) {
  return fail(ErrorCode::kConfiguration, path.string() + ": " + what + "; expected " + expected);
}

Result<TagPlan> parse_corners(const std::filesystem::path& path, const std::string& content) {
  const auto refuse = [&](const std::string& what) {
    return wrong(path, what,
                 "{\"ID\": [[x, y, 0], three more corners], ...}, or the yaml of Kalibr's aprilgrid");
  };
  const auto json = nlohmann::json::parse(content, nullptr, false);
  if (!json.is_object()) return refuse("not a JSON object");
  TagPlan plan;
  for (const auto& [key, value] : json.items()) {
    int id = 0;
    const auto [end, error] = std::from_chars(key.data(), key.data() + key.size(), id);
    if (error != std::errc() || end != key.data() + key.size()) continue;  // notes on the paper and the like
    auto& corners = plan.tags[id];
    if (!value.is_array() || value.size() != corners.size())
      return refuse("tag " + key + " has not four corners");
    for (size_t k = 0; k < corners.size(); ++k) {
      const auto& corner = value[k];
      if (!corner.is_array() || corner.size() < 2 || !corner[0].is_number() || !corner[1].is_number()) {
        return refuse("tag " + key + ": a corner is not a list of numbers");
      }
      corners[k] = {corner[0].get<double>(), corner[1].get<double>(), 0};
      constexpr double kFlat = 1e-6;
      if (corner.size() > 2 && !(corner[2].is_number() && std::abs(corner[2].get<double>()) < kFlat)) {
        return refuse("tag " + key + " is not in the plane z = 0");
      }
    }
  }
  if (plan.tags.empty()) return refuse("no tag in it");
  return plan;
}

/// Kalibr's rows go up from the lower left; here y goes down, as in the image.
TagPlan lay_grid(int columns, int rows, double size, double spacing) {
  TagPlan plan;
  plan.border = 2;
  const double pitch = size * (1 + spacing);
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const double left = column * pitch;
      const double upper = (rows - 1 - row) * pitch;
      plan.tags[row * columns + column] = {Eigen::Vector3d(left, upper, 0),
                                           {left + size, upper, 0},
                                           {left + size, upper + size, 0},
                                           {left, upper + size, 0}};
    }
  }
  return plan;
}

Result<TagPlan> parse_aprilgrid(const std::filesystem::path& path, const std::string& content) {
  const auto refuse = [&](const std::string& what) {
    return wrong(
        path, what,
        "the yaml of Kalibr's aprilgrid: target_type: 'aprilgrid', tagCols, tagRows (counts), tagSize "
        "(the side of a tag), tagSpacing (between two, in sides)");
  };
  YAML::Node root;
  try {
    root = YAML::Load(content);
  } catch (const YAML::Exception& exception) {
    return refuse(exception.what());
  }
  if (!root.IsMap()) return refuse("not a yaml map");
  const auto type = root["target_type"];
  if (!type || !type.IsScalar()) return refuse("no target_type in it");
  if (type.Scalar() == "checkerboard")
    return refuse("target_type 'checkerboard': pass --board chessboard --squares COLSxROWS");
  if (type.Scalar() != "aprilgrid") return refuse("target_type " + in_quotes(type.Scalar()) + " is not read");
  const auto number = [&](const char* key) {
    const auto node = root[key];
    return node && node.IsScalar() ? parse_number(node.Scalar()).value_or(0) : 0;
  };
  constexpr double kMostTags = 100;  // in a row
  for (const char* key : {"tagCols", "tagRows"}) {
    if (!(number(key) >= 1 && number(key) <= kMostTags && number(key) == std::floor(number(key))))
      return refuse(std::string(key) + " is not a whole number from 1 to 100");
  }
  for (const char* key : {"tagSize", "tagSpacing"}) {
    if (!(number(key) > 0)) return refuse(std::string(key) + " is not a number above 0");
  }
  return lay_grid(static_cast<int>(number("tagCols")), static_cast<int>(number("tagRows")), number("tagSize"),
                  number("tagSpacing"));
}

}  // namespace

Result<TagPlan> read_tag_plan(const std::filesystem::path& path) {
  const auto content = read_text_file(path);
  if (!content) return tl::unexpected(content.error());
  const bool is_yaml = content->find("target_type") != std::string::npos && !trim(*content).starts_with('{');
  return is_yaml ? parse_aprilgrid(path, *content) : parse_corners(path, *content);
}

}  // namespace cairn
