// SPDX-License-Identifier: Apache-2.0
#include "common/io/trajectory.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <utility>

#include "common/base/utf8.h"
#include "common/io/text.h"

namespace cairn {
namespace {

constexpr std::string_view kRowFormat = "expected `t tx ty tz qx qy qz qw`, or EuRoC's data.csv";
constexpr size_t kPoseFields = 8;
constexpr size_t kTurn = 4;  ///< the field where the quaternion begins

/// How the rows of a file are meant.
struct RowForm {
  bool is_nanoseconds = false;
  bool has_more_fields = false;  ///< velocities and the like may follow the pose
  bool w_first = false;
};

/// Begins a new segment if the comment is a map row. Other comments say nothing to us.
void read_comment(std::string_view text, Trajectory& trajectory) {
  constexpr std::string_view kMapWord = "map ";
  text = trim(text.substr(1));
  if (!text.starts_with(kMapWord)) return;
  text = trim(text.substr(kMapWord.size()));
  const size_t id_end = std::min(text.find(' '), text.size());
  const auto bytes = from_hex(text.substr(0, id_end));
  if (!bytes) return;
  trajectory.segments.push_back({MapId{*bytes}, one_line(trim(text.substr(id_end))), {}});
}

/// Names of a heading's columns: its words, or where commas part it the first word of each.
std::vector<std::string_view> columns_of(std::string_view heading) {
  heading = trim(heading.substr(heading.starts_with('#') ? 1 : 0));
  if (heading.find(',') == std::string_view::npos) return split_fields(heading);
  std::vector<std::string_view> columns;
  for (size_t begin = 0; begin <= heading.size();) {
    const size_t end = std::min(heading.find(',', begin), heading.size());
    const auto words = split_fields(heading.substr(begin, end - begin));
    columns.push_back(words.empty() ? std::string_view() : words.front());
    begin = end + 1;
  }
  return columns;
}

/// What a heading says of the quaternion's order ("qw qx qy qz", "q_RS_w [], q_RS_x []"); nothing if it is
/// none.
std::optional<bool> heading_says_w_first(std::string_view heading) {
  const auto columns = columns_of(heading);
  if (columns.size() < kPoseFields) return std::nullopt;
  const auto is = [&](size_t column, char part) {
    const auto name = columns[column];
    return name.size() >= 2 && (name.front() == 'q' || name.front() == 'Q') && name.back() == part;
  };
  if (is(kTurn, 'w') && is(kTurn + 1, 'x')) return true;
  if (is(kTurn, 'x') && is(kTurn + 3, 'w')) return false;
  return std::nullopt;
}

/// A time in nanoseconds: a number too large for seconds; EuRoC writes none with a fraction, ORB-SLAM zeros.
std::optional<Timestamp> parse_nanoseconds(std::string_view text) {
  Timestamp time;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), time.nanoseconds);
  const auto rest = std::string_view(end, static_cast<size_t>(text.data() + text.size() - end));
  const bool is_whole = rest.empty() || (rest.front() == '.' &&
                                         rest.find_first_not_of("0123456789", 1) == std::string_view::npos);
  return error == std::errc() && is_whole ? std::optional(time) : std::nullopt;
}

/// The first row of data and the heading, if any, tell how all rows are meant.
RowForm form_of(const std::vector<TextLine>& lines) {
  RowForm form;
  std::optional<bool> w_first;
  for (const TextLine& line : lines) {
    if (is_blank(line.text)) continue;
    if (line.text.front() == '#' || is_heading(line.text)) {
      const auto said = heading_says_w_first(line.text);
      if (said) w_first = said;
      form.is_nanoseconds |= line.text.find("[ns]") != std::string_view::npos;
      continue;
    }
    const auto time = split_fields(line.text).front();
    form.is_nanoseconds |= !parse_timestamp(time) && parse_nanoseconds(time).has_value();
    break;
  }
  const bool has_commas = std::any_of(lines.begin(), lines.end(), [](const TextLine& line) {
    return !line.text.starts_with('#') && line.text.find(',') != std::string_view::npos;
  });
  form.has_more_fields = form.is_nanoseconds && has_commas;
  form.w_first = w_first.value_or(form.has_more_fields);
  return form;
}

tl::unexpected<Error> not_a_row(size_t fields) {
  constexpr size_t kKittiFields = 12;
  return fail(
      ErrorCode::kDamaged,
      std::to_string(fields) + " fields, not 8; " +
          (fields == kKittiFields
               ? "KITTI's poses have no times: put them in front and write quaternions (evo_traj kitti ...)"
               : std::string(kRowFormat)));
}

/// "nan", "-inf": a number that is none.
bool is_not_finite(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() && !std::isfinite(value);
}

/// Reads a row. Nothing for one that says that there is no pose: NaN, or the zeros of a motion capture that
/// saw nothing.
Result<std::optional<StampedPose>> parse_row(std::string_view text, const RowForm& form) {
  const auto fields = split_fields(text);
  if (fields.size() < kPoseFields || (fields.size() > kPoseFields && !form.has_more_fields))
    return not_a_row(fields.size());
  const auto time = form.is_nanoseconds ? parse_nanoseconds(fields[0]) : parse_timestamp(fields[0]);
  if (!time) {
    return fail(ErrorCode::kDamaged, in_quotes(fields[0]) + " is not a time in " +
                                         (form.is_nanoseconds ? "nanoseconds" : "seconds"));
  }
  if (std::any_of(fields.begin() + 1, fields.begin() + kPoseFields, is_not_finite)) return std::nullopt;
  std::array<double, kPoseFields - 1> v{};
  for (size_t i = 0; i < v.size(); ++i) {
    const auto number = parse_number(fields[i + 1]);
    if (!number) return fail(ErrorCode::kDamaged, in_quotes(fields[i + 1]) + " is not a number");
    v[i] = *number;
  }
  const auto rotation =
      form.w_first ? Eigen::Quaterniond(v[3], v[4], v[5], v[6]) : Eigen::Quaterniond(v[6], v[3], v[4], v[5]);
  if (rotation.coeffs().isZero(0)) return std::nullopt;
  // Files carry 4 digits or more of a unit quaternion; anything else is another column order or another
  // format.
  if (std::abs(rotation.norm() - 1) > 0.05) {
    return fail(ErrorCode::kDamaged, "the quaternion's norm is " + std::to_string(rotation.norm()) +
                                         ", not 1; " + std::string(kRowFormat));
  }
  return StampedPose{*time, SE3(rotation, {v[0], v[1], v[2]})};
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
  const auto lines = all_lines(*content);
  const RowForm form = form_of(lines);
  Trajectory trajectory;
  trajectory.is_of_body = form.is_nanoseconds && form.has_more_fields;
  bool at_first_row = true;
  for (const auto& line : lines) {
    if (is_blank(line.text)) continue;
    if (line.text.front() == '#') {
      read_comment(line.text, trajectory);
      continue;
    }
    if (std::exchange(at_first_row, false) && is_heading(line.text)) continue;
    const auto pose = parse_row(line.text, form);
    if (!pose) return fail(pose.error().code, at_line(path, line.number, pose.error().message));
    if (!*pose) {
      ++trajectory.rows_left_out;
      continue;
    }
    if (trajectory.segments.empty()) trajectory.segments.emplace_back();
    trajectory.segments.back().poses.push_back(**pose);
  }
  std::erase_if(trajectory.segments, [](const TrajectorySegment& segment) { return segment.poses.empty(); });
  if (!trajectory.segments.empty()) return trajectory;
  return fail(ErrorCode::kDamaged,
              path.string() + ": no pose in it" +
                  (trajectory.rows_left_out == 0 ? ""
                                                 : "; all " + std::to_string(trajectory.rows_left_out) +
                                                       " rows have NaN or a quaternion of zeros"));
}

Result<TrajectoryWriter> TrajectoryWriter::open(const std::filesystem::path& path) {
  auto stream = StreamWriter::open(path);
  if (!stream) return tl::unexpected(stream.error());
  return TrajectoryWriter(std::move(*stream));
}

Status TrajectoryWriter::append(const MapId& map, std::string_view map_name, const StampedPose& pose) {
  std::string text;
  if (current_map_ != map) {
    // It comes from other machines: a line break in it must not make rows.
    const auto name = one_line(trim(map_name));
    text = "# map " + to_hex(map.bytes) + (name.empty() ? "" : " ") + name + '\n';
  }
  const auto& t = pose.map_from_camera.translation();
  Eigen::Quaterniond q = pose.map_from_camera.rotation();
  if (q.w() < 0) q.coeffs() *= -1;
  std::array<char, 512> row{};
  const int length =
      std::snprintf(row.data(), row.size(), "%s %.9f %.9f %.9f %.9f %.9f %.9f %.9f\n",
                    format_timestamp(pose.time).c_str(), t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
  text.append(row.data(), static_cast<size_t>(std::clamp<int>(length, 0, row.size() - 1)));
  // The row of a map goes with the first pose that is not left out.
  if (stream_->write(std::move(text))) current_map_ = map;
  return stream_->status();
}

Status TrajectoryWriter::finish(DrainPatience patience, const std::function<bool()>& stop_requested) {
  return stream_->finish(patience, stop_requested);
}

}  // namespace cairn
