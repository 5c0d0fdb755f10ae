// SPDX-License-Identifier: Apache-2.0
#include "common/io/sensor_yaml.h"

#include <cmath>

#include "common/io/calibration_keys.h"

namespace cairn {
namespace {

constexpr double kMostTimeShift = 1e9;  // [s]: such that times of clocks can be told from each other

/// A list of the 16 numbers of a 4x4 matrix, or of its rows.
Result<SE3> rigid_motion(const calibration::Keys& keys, const char* key) {
  const auto numbers = keys.numbers(key, 16);
  if (!numbers) return tl::unexpected(numbers.error());
  const Eigen::Matrix4d m = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(numbers->data());
  const Eigen::Matrix3d rotation = m.topLeftCorner<3, 3>();
  constexpr double kRounding = 1e-3;
  const bool is_rigid = (rotation * rotation.transpose()).isIdentity(kRounding) &&
                        rotation.determinant() > 0 &&
                        m.row(3).isApprox(Eigen::RowVector4d(0, 0, 0, 1), kRounding);
  if (!is_rigid) return keys.error_at(key, std::string(key) + " is not a rotation and a translation");
  return SE3(rotation, Eigen::Vector3d(m.topRightCorner<3, 1>()));
}

Result<std::optional<SensorMount>> parse_mount(const calibration::Keys& keys) {
  constexpr const char* kKey = "T_BS";
  if (!keys.has(kKey)) return std::nullopt;
  const auto body_from_sensor = rigid_motion(keys, kKey);
  if (!body_from_sensor) return tl::unexpected(body_from_sensor.error());
  // Something else than a word is no type that anybody knows.
  const std::string type = keys.has("sensor_type") ? keys.word("sensor_type").value_or("?") : "";
  return SensorMount{*body_from_sensor, type};
}

Result<std::optional<KalibrImu>> parse_kalibr(const calibration::Keys& chain) {
  const calibration::Keys keys = chain.below("cam0");
  if (!keys.has("T_cam_imu")) return std::nullopt;
  const auto camera_from_imu = rigid_motion(keys, "T_cam_imu");
  if (!camera_from_imu) return tl::unexpected(camera_from_imu.error());
  KalibrImu imu{*camera_from_imu};
  if (!keys.has("timeshift_cam_imu")) return imu;
  const auto shift = keys.number("timeshift_cam_imu");
  if (!shift) return tl::unexpected(shift.error());
  if (!(std::abs(*shift) <= kMostTimeShift))
    return keys.error_at("timeshift_cam_imu", "timeshift_cam_imu is not within +-1e9 s");
  imu.time_shift = *shift;
  return imu;
}

/// Nothing for what is no map of keys.
template <typename Value>
Result<std::optional<Value>> read_yaml(const std::filesystem::path& path,
                                       Result<std::optional<Value>> (*parse)(const calibration::Keys&)) {
  const auto content = read_text_file(path);
  if (!content) return tl::unexpected(content.error());
  const calibration::File file{path, *content, {}, {}};
  try {
    const YAML::Node root = YAML::Load(*content);
    if (!root.IsMap()) return std::nullopt;
    return parse(calibration::Keys(file, root));
  } catch (const YAML::Exception& error) {
    return calibration::wrong(path.string() + ": not YAML: " + error.msg);
  }
}

}  // namespace

Result<std::optional<SensorMount>> read_sensor_mount(const std::filesystem::path& path) {
  return read_yaml(path, parse_mount);
}

Result<std::optional<KalibrImu>> read_kalibr_imu(const std::filesystem::path& path) {
  return read_yaml(path, parse_kalibr);
}

}  // namespace cairn
