// SPDX-License-Identifier: Apache-2.0
#include "common/io/trajectory.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <numeric>

#include "common/io/text.h"

namespace cairn {
namespace {

constexpr std::string_view kRowFormat = "expected `t tx ty tz qx qy qz qw`";

/// Begins a new segment if the comment is a map row. Other comments say nothing to us.
void read_comment(std::string_view text, Trajectory& trajectory) {
  constexpr std::string_view kMapWord = "map ";
  text = trim(text.substr(1));
  if (!text.starts_with(kMapWord)) return;
  text = trim(text.substr(kMapWord.size()));
  const size_t id_end = std::min(text.find(' '), text.size());
  const auto bytes = from_hex(text.substr(0, id_end));
  if (!bytes) return;
  trajectory.segments.push_back({MapId{*bytes}, std::string(trim(text.substr(id_end))), {}});
}

Result<StampedPose> parse_row(std::string_view text) {
  const auto fields = split_fields(text);
  if (fields.size() != 8) {
    return fail(ErrorCode::kDamaged,
                std::to_string(fields.size()) + " fields, not 8; " + std::string(kRowFormat));
  }
  const auto time = parse_timestamp(fields[0]);
  if (!time) return fail(ErrorCode::kDamaged, in_quotes(fields[0]) + " is not a time in seconds");
  std::array<double, 7> v{};
  for (size_t i = 0; i < v.size(); ++i) {
    const auto number = parse_number(fields[i + 1]);
    if (!number) return fail(ErrorCode::kDamaged, in_quotes(fields[i + 1]) + " is not a number");
    v[i] = *number;
  }
  const Eigen::Quaterniond rotation(v[6], v[3], v[4], v[5]);
  // Files carry 4 digits or more of a unit quaternion; anything else is another column order or another
  // format.
  if (std::abs(rotation.norm() - 1) > 0.05) {
    return fail(ErrorCode::kDamaged, "the quaternion's norm is " + std::to_string(rotation.norm()) +
                                         ", not 1; " + std::string(kRowFormat));
  }
  return StampedPose{*time, SE3(rotation, {v[0], v[1], v[2]})};
}

/// A name comes from other machines: a line break or control character in it must not make rows.
std::string printable(std::string_view name) {
  std::string text(trim(name));
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < 0x20 || c == 0x7f; }, '?');
  return text;
}

}  // namespace

size_t Trajectory::pose_count() const {
  return std::accumulate(
      segments.begin(), segments.end(), size_t{0},
      [](size_t sum, const TrajectorySegment& segment) { return sum + segment.poses.size(); });
}

Result<Trajectory> read_trajectory(const std::filesystem::path& path) {
  const auto content = read_text_file(path);
  if (!content) return tl::unexpected(content.error());
  Trajectory trajectory;
  for (const auto& line : all_lines(*content)) {
    if (line.text.empty()) continue;
    if (line.text.front() == '#') {
      read_comment(line.text, trajectory);
      continue;
    }
    const auto pose = parse_row(line.text);
    if (!pose) return fail(pose.error().code, at_line(path, line.number, pose.error().message));
    if (trajectory.segments.empty()) trajectory.segments.emplace_back();
    trajectory.segments.back().poses.push_back(*pose);
  }
  std::erase_if(trajectory.segments, [](const TrajectorySegment& segment) { return segment.poses.empty(); });
  if (trajectory.segments.empty()) return fail(ErrorCode::kDamaged, path.string() + ": no pose in it");
  return trajectory;
}

Result<TrajectoryWriter> TrajectoryWriter::open(const std::filesystem::path& path) {
  std::ofstream file(path, std::ios::binary | std::ios::trunc);
  if (!file) return fail(ErrorCode::kIo, cannot_be_written(path));
  return TrajectoryWriter(path, std::move(file));
}

Status TrajectoryWriter::append(const MapId& map, std::string_view map_name, const StampedPose& pose) {
  file_.clear();
  if (current_map_ != map) {
    const auto name = printable(map_name);
    file_ << "# map " << to_hex(map.bytes) << (name.empty() ? "" : " ") << name << '\n';
  }
  const auto& t = pose.map_from_camera.translation();
  Eigen::Quaterniond q = pose.map_from_camera.rotation();
  if (q.w() < 0) q.coeffs() *= -1;
  std::array<char, 512> row{};
  const int length =
      std::snprintf(row.data(), row.size(), "%s %.9f %.9f %.9f %.9f %.9f %.9f %.9f\n",
                    format_timestamp(pose.time).c_str(), t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
  file_.write(row.data(), std::clamp<std::streamsize>(length, 0, row.size() - 1));
  file_.flush();
  if (!file_) return fail(ErrorCode::kIo, cannot_be_written(path_));
  current_map_ = map;
  return {};
}

}  // namespace cairn
