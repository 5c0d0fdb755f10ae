// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/rig_configuration.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>

#include "common/base/option_yaml.h"
#include "common/base/suggestion.h"
#include "common/base/yaml_file.h"
#include "common/map/ids.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr double kRadians = std::numbers::pi / 180;
constexpr double kLowestNode = 4;               // below are the identifiers of the IMU
constexpr double kHighestFeedforward = 32.767;  // [turns/s], of SetInputPosition
constexpr double kLeastAhead = 0.2;             // of a camera's axis: the rest is to the side
constexpr double kLargestOffset = 1000;         // [ms]
constexpr double kLongestLag = 50;              // [ms]
constexpr double kTwoOrders = 40;               // [ms] commanders speak each 20 ms
constexpr double kSafeIdle = 100;               // [ms] from a death to idle drives, at most

/// Reads the values of one mapping and remembers the first that is wrong: that is what the operator is told.
class Section {
 public:
  Section(std::string path, const YAML::Node& node, std::string name)
      : path_(std::move(path)), node_(node), name_(std::move(name)) {
    if (!node_.IsMap()) refuse(node_, "expected `key: value` lines");
  }

  [[nodiscard]] bool known(const std::string& key) const { return node_.IsMap() && node_[key].IsDefined(); }
  /// The number of a key, within `least` and `most`, both included.
  double number(const std::string& key, double least, double most) {
    const YAML::Node value = find(key);
    return value ? number_at(value, key, least, most) : least;
  }
  /// The same, or `otherwise` where the key is not there.
  double number_or(const std::string& key, double least, double most, double otherwise) {
    if (known(key)) return number(key, least, most);
    asked_.push_back(key);
    return otherwise;
  }
  double positive(const std::string& key) {
    const YAML::Node value = find(key);
    if (!value) return 1;
    const double number = number_at(value, key, -HUGE_VAL, HUGE_VAL);
    if (number <= 0) refuse(value, fmt::format("{} {}: expected a number above 0", key, value.Scalar()));
    return number;
  }
  std::array<double, 2> range(const std::string& key) {
    const YAML::Node value = find(key);
    if (!value) return {0, 1};
    if (!value.IsSequence() || value.size() != 2) {
      refuse(value, fmt::format("{}: expected two numbers, `{}: [-60, 60]`", key, key));
      return {0, 1};
    }
    const std::array<double, 2> range = {number_at(value[0], key, -HUGE_VAL, HUGE_VAL),
                                         number_at(value[1], key, -HUGE_VAL, HUGE_VAL)};
    if (range[0] >= range[1])
      refuse(value, fmt::format("{}: the limits are crossed; write the lower one first", key));
    return range;
  }
  /// Three numbers; zeros where the key is not there.
  Eigen::Vector3d vector_or_zero(const std::string& key, double most) {
    asked_.push_back(key);
    if (!known(key)) return Eigen::Vector3d::Zero();
    const YAML::Node value = node_[key];
    if (!value.IsSequence() || value.size() != 3) {
      refuse(value, fmt::format("{}: expected three numbers, `{}: [0, 0, 0]`", key, key));
      return Eigen::Vector3d::Zero();
    }
    return {number_at(value[0], key, -most, most), number_at(value[1], key, -most, most),
            number_at(value[2], key, -most, most)};
  }
  std::string word(const std::string& key) {
    const YAML::Node value = find(key);
    if (!value) return {};
    if (!value.IsScalar()) refuse(value, fmt::format("{}: expected a word", key));
    return value.IsScalar() ? value.Scalar() : std::string();
  }
  std::optional<Section> section(const std::string& key, bool optional = false) {
    if (optional && !known(key)) {
      asked_.push_back(key);
      return std::nullopt;
    }
    const YAML::Node value = find(key);
    if (!value) return std::nullopt;
    return Section(path_, value, name_.empty() ? key : name_ + "." + key);
  }

  /// The node of a key, for another reader; undefined where the key is not there.
  YAML::Node mapping_or_nothing(const std::string& key) {
    asked_.push_back(key);
    return known(key) ? node_[key] : YAML::Node(YAML::NodeType::Undefined);
  }

  /// Refuses the value of `key` unless `check` holds. Nothing is said where a key is missing: that comes
  /// first.
  void require(bool check, const std::string& key, const std::string& why) {
    if (!check && !missing_) refuse(known(key) ? node_[key] : node_, key + ": " + why);
  }
  /// Ends the reading: refuses a key that was not asked for, and one that is there twice.
  void finish() {
    if (error_) return;
    std::vector<std::string> seen;
    for (const auto& entry : node_) {
      const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : std::string();
      if (std::find(asked_.begin(), asked_.end(), key) == asked_.end())
        refuse(entry.first, fmt::format("unknown key '{}'{}", key, did_you_mean(key, asked_)));
      if (std::find(seen.begin(), seen.end(), key) != seen.end())
        refuse(entry.first, fmt::format("'{}' is there twice; keep one", key));
      seen.push_back(key);
    }
  }
  /// Refuses, after finish(), a key that was asked for and is not there.
  void refuse_missing() {
    if (missing_) refuse(node_, fmt::format("{} is missing; add `{}: ...`", *missing_, *missing_));
  }
  [[nodiscard]] const std::optional<Error>& error() const { return error_; }
  void take_error(const Section& part) {
    if (!error_) error_ = part.error();
  }

 private:
  YAML::Node find(const std::string& key) {
    asked_.push_back(key);
    if (known(key)) return node_[key];
    // A misspelt key is the likelier reason, and finish() names it.
    if (node_.IsMap() && !missing_) missing_ = key;
    return YAML::Node(YAML::NodeType::Undefined);
  }

  double number_at(const YAML::Node& value, const std::string& key, double least, double most) {
    const std::string text = value.IsScalar() ? value.Scalar() : std::string();
    const size_t plus = text.starts_with('+') ? 1 : 0;
    double number = 0;
    const auto [end, problem] = std::from_chars(text.data() + plus, text.data() + text.size(), number);
    const bool whole = problem == std::errc() && end == text.data() + text.size() && std::isfinite(number);
    if (!whole) {
      refuse(value, fmt::format("{} '{}': expected a number", key, text));
    } else if (number < least || number > most) {
      refuse(value, fmt::format("{} {}: expected {} to {}", key, text, least, most));
    } else {
      return number;
    }
    return std::isfinite(least) ? least : 0;
  }
  void refuse(const YAML::Node& at, const std::string& why) {
    if (error_) return;
    error_ = Error{ErrorCode::kConfiguration, fmt::format("{}:{}: {}{}{}", path_, at.Mark().line + 1, name_,
                                                          name_.empty() ? "" : ": ", why)};
  }

  std::string path_;
  YAML::Node node_;
  std::string name_;
  std::vector<std::string> asked_;
  std::optional<std::string> missing_;
  std::optional<Error> error_;
};

void close(Section& section) {
  section.finish();
  section.refuse_missing();
}

AxisConfiguration read_axis(Section& from) {
  AxisConfiguration axis;
  const double node = from.number("node", kLowestNode, odrive::kMaxNode);
  from.require(node == std::floor(node), "node", "expected a whole number");
  axis.node.value = static_cast<uint8_t>(node);
  const double gear = from.number("gear", -1e4, 1e4);
  from.require(gear != 0, "gear", "0 turns nothing; expected turns of the motor for one of the axis");
  axis.turns_per_radian = gear / (2 * std::numbers::pi);
  const auto [low, high] = from.range("position");
  const double margin = from.positive("margin");
  from.require(2 * margin < high - low, "margin", "nothing is left between the soft limits; make it smaller");
  const double home = from.number("home", -360, 360);
  from.require(home >= low && home <= high, "home", "the homing switch is outside of `position`");
  const double neutral = from.number("neutral", -360, 360);
  from.require(neutral >= low + margin && neutral <= high - margin, "neutral",
               "outside of the soft limits, which are `position` less `margin` on either side");
  const double rate = from.positive("rate");
  from.require(
      rate / 360 * std::abs(gear) <= kHighestFeedforward, "rate",
      fmt::format("with this gear the motor would have to make more than {} turns/s, which no frame can "
                  "say; lower it",
                  kHighestFeedforward));
  axis.home = home * kRadians;
  axis.neutral = neutral * kRadians;
  axis.limits = {.low = low * kRadians,
                 .high = high * kRadians,
                 .margin = margin * kRadians,
                 .rate = rate * kRadians,
                 .acceleration = from.positive("acceleration") * kRadians,
                 .coasting = from.positive("coasting") * kRadians,
                 .reaction = 1 / from.positive("gain"),
                 .lag = from.number_or("lag", 0, kLongestLag, 0) / 1000};
  axis.backlash = from.number_or("backlash", 0, margin, 0) * kRadians;
  axis.current = from.positive("current");
  close(from);
  return axis;
}

void read_deadlines(Section& from, RigConfiguration& rig) {
  const auto period = static_cast<double>(rig.period.count());
  const auto deadline = [&](const char* key, double least = 0) {
    const double shortest = std::max(2 * period, least);
    return milliseconds(static_cast<int64_t>(from.number(key, shortest, kSafeIdle - 2 * period)));
  };
  rig.commander_deadline = deadline("commander", kTwoOrders);
  rig.imu_deadline = deadline("imu");
  rig.drive_deadline = deadline("drive");
  close(from);
}

RigCalibration read_calibration(Section& from) {
  const auto turned = [&](const char* key) {
    const Eigen::Vector3d turn = from.vector_or_zero(key, 180) * kRadians;
    return Eigen::Quaterniond(Eigen::AngleAxisd(turn.norm(), turn.stableNormalized()));
  };
  RigCalibration calibration;
  calibration.head_from_camera = turned("camera") * nominal_head_from_camera();
  from.require(std::hypot((calibration.head_from_camera * Eigen::Vector3d::UnitZ()).x(),
                          (calibration.head_from_camera * Eigen::Vector3d::UnitZ()).z()) > kLeastAhead,
               "camera", "it would look along the tilt axis, which turns it to nowhere");
  calibration.head_from_imu = turned("imu");
  calibration.offset = std::chrono::nanoseconds(
      std::llround(1e6 * from.number_or("offset", -kLargestOffset, kLargestOffset, 0)));
  calibration.knows_mounts = from.known("camera") && from.known("imu");
  calibration.knows_offset = from.known("offset");
  close(from);
  return calibration;
}

void read_axes(Section& from, RigConfiguration& rig) {
  for (const AxisName name : kAxisNames) {
    auto section = from.section(to_string(name));
    if (!section) continue;
    rig.axes.at(static_cast<size_t>(name)) = read_axis(*section);
    from.take_error(*section);
  }
  close(from);
  from.require(rig.axes[0].node != rig.axes[1].node, "tilt",
               fmt::format("node {} is that of pan too; each drive needs its own", rig.axes[1].node.value));
}

}  // namespace

const char* to_string(AxisName name) {
  return name == AxisName::kPan ? "pan" : "tilt";
}

Result<RigConfiguration> read_rig_configuration(const std::filesystem::path& path) {
  const auto loaded = load_yaml(path);
  if (!loaded) return tl::unexpected(loaded.error());
  Section root(path.string(), *loaded, "");
  RigConfiguration rig;
  rig.name = root.word("name");
  root.require(is_valid_name(rig.name), "name", "expected 1 to 32 of a-z, 0-9 and -");
  rig.period = milliseconds(static_cast<int64_t>(root.number("period", 2, 20)));
  if (auto section = root.section("deadlines")) {
    read_deadlines(*section, rig);
    root.take_error(*section);
  }
  if (auto section = root.section("imu", true)) {
    rig.imu = ImuConfiguration{section->number("rate", 50, 400)};
    close(*section);
    root.take_error(*section);
  }
  if (auto section = root.section("calibration", true)) {
    rig.calibration = read_calibration(*section);
    root.take_error(*section);
  }
  if (auto section = root.section("axes")) {
    read_axes(*section, rig);
    root.take_error(*section);
  }
  const YAML::Node tuning = root.mapping_or_nothing("tuning");
  close(root);
  if (root.error()) return tl::unexpected(*root.error());
  if (tuning) {
    if (const Status read = read_options(tuning, path.string(), list_options(&rig.tuning)); !read)
      return tl::unexpected(read.error());
  }
  return rig;
}

}  // namespace cairn
