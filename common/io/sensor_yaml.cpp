// SPDX-License-Identifier: Apache-2.0
#include "common/io/sensor_yaml.h"

#include "common/io/calibration_keys.h"

namespace cairn {
namespace {

Result<std::optional<SensorMount>> parse_mount(const calibration::Keys& keys) {
  constexpr const char* kKey = "T_BS";
  if (!keys.has(kKey)) return std::nullopt;
  const auto numbers = keys.numbers(kKey, 16);
  if (!numbers) return tl::unexpected(numbers.error());
  const Eigen::Matrix4d m = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(numbers->data());
  const Eigen::Matrix3d rotation = m.topLeftCorner<3, 3>();
  constexpr double kRounding = 1e-3;
  const bool is_rigid = (rotation * rotation.transpose()).isIdentity(kRounding) &&
                        rotation.determinant() > 0 &&
                        m.row(3).isApprox(Eigen::RowVector4d(0, 0, 0, 1), kRounding);
  if (!is_rigid) return keys.error_at(kKey, "T_BS is not a rotation and a translation");
  const bool is_camera = !keys.has("sensor_type") || keys.word("sensor_type").value_or("") == "camera";
  return SensorMount{SE3(rotation, Eigen::Vector3d(m.topRightCorner<3, 1>())), is_camera};
}

}  // namespace

Result<std::optional<SensorMount>> read_sensor_mount(const std::filesystem::path& path) {
  const auto content = read_text_file(path);
  if (!content) return tl::unexpected(content.error());
  const calibration::File file{path, *content, {}, {}};
  try {
    const YAML::Node root = YAML::Load(*content);
    if (!root.IsMap()) return std::nullopt;
    return parse_mount(calibration::Keys(file, root));
  } catch (const YAML::Exception& error) {
    return calibration::wrong(path.string() + ": not YAML: " + error.msg);
  }
}

}  // namespace cairn
