// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <yaml-cpp/yaml.h>

#include <initializer_list>
#include <string>
#include <vector>

#include "common/io/calibration_formats.h"
#include "common/io/text.h"

// Within common/io only.
namespace cairn::calibration {

/// Reads the keys of one YAML map; each error names the file and, where the key exists, its line.
class Keys {
 public:
  Keys(const File& file, const YAML::Node& root) : file_(file), root_(root) {}

  [[nodiscard]] bool has(const char* key) const { return static_cast<bool>(root_[key]); }
  /// The map under `key`; one without keys where there is none.
  [[nodiscard]] Keys below(const char* key) const {
    const auto node = root_[key];
    return {file_, node && node.IsMap() ? node : YAML::Node(YAML::NodeType::Map)};
  }

  [[nodiscard]] tl::unexpected<Error> error_at(const YAML::Node& node, const std::string& message) const {
    const int line = node.Mark().line;
    if (line < 0) return error(message);  // was XML
    return wrong(at_line(file_.path, static_cast<size_t>(line) + 1, message));
  }
  [[nodiscard]] tl::unexpected<Error> error_at(const char* key, const std::string& message) const {
    return error_at(root_[key], message);
  }
  /// An error about the file as a whole.
  [[nodiscard]] tl::unexpected<Error> error(const std::string& message) const {
    return wrong(file_.path.string() + ": " + message);
  }
  [[nodiscard]] tl::unexpected<Error> missing(const char* key) const {
    return error(std::string("no '") + key + "' in it; calibrate again or add it");
  }

  [[nodiscard]] Result<double> number(const char* key) const {
    const auto node = root_[key];
    if (!node) return missing(key);
    const auto value = node.IsScalar() ? parse_number(node.Scalar()) : std::nullopt;
    if (!value) return error_at(node, std::string(key) + " is not a number");
    return *value;
  }
  /// Several of them, in this order.
  [[nodiscard]] Result<std::vector<double>> each(std::initializer_list<const char*> names) const {
    std::vector<double> values;
    for (const char* name : names) {
      const auto value = number(name);
      if (!value) return tl::unexpected(value.error());
      values.push_back(*value);
    }
    return values;
  }
  [[nodiscard]] Result<int> side(const char* key) const {
    const auto value = number(key);
    if (!value) return tl::unexpected(value.error());
    const int side = side_from_number(*value);
    if (side == 0) return error_at(key, std::string(key) + " must be a positive whole number");
    return side;
  }

  [[nodiscard]] Result<std::string> word(const char* key) const {
    const auto node = root_[key];
    if (!node) return missing(key);
    if (!node.IsScalar()) return error_at(node, std::string(key) + " is not a word");
    return node.Scalar();
  }

  /// A list of numbers, or of rows of them as Kalibr writes matrices: the node itself, or its `data` as
  /// OpenCV and ROS do.
  [[nodiscard]] Result<std::vector<double>> numbers(const char* key) const {
    const auto node = root_[key];
    if (!node) return missing(key);
    const auto data = node.IsMap() ? node["data"] : node;
    if (!data || !data.IsSequence()) {
      return error_at(node, std::string(key) + (node.IsMap() ? " has no list 'data'" : " is not a list"));
    }
    std::vector<double> values;
    for (const auto& item : data) {
      if (auto status = append(key, item, &values); !status) return tl::unexpected(status.error());
    }
    return values;
  }

  [[nodiscard]] Result<std::vector<double>> numbers(const char* key, size_t count) const {
    auto values = numbers(key);
    if (values && values->size() != count) {
      return error_at(key, std::string(key) + ": " + std::to_string(values->size()) + " numbers, not " +
                               std::to_string(count));
    }
    return values;
  }

 private:
  /// A number, or a row of them.
  [[nodiscard]] Status append(const char* key, const YAML::Node& item, std::vector<double>* values) const {
    if (item.IsSequence()) {
      for (const auto& number : item) {
        if (auto status = number.IsSequence() ? error_at(number, std::string(key) + ": not a number")
                                              : append(key, number, values);
            !status)
          return status;
      }
      return {};
    }
    const auto value = item.IsScalar() ? parse_number(item.Scalar()) : std::nullopt;
    if (!value) return error_at(item, std::string(key) + ": not a number");
    values->push_back(*value);
    return {};
  }

  const File& file_;
  YAML::Node root_;
};

}  // namespace cairn::calibration
