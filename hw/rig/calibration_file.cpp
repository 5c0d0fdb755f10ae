// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/calibration_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <numbers>
#include <optional>
#include <sstream>
#include <vector>

#include "common/base/file_descriptor.h"
#include "common/geometry/se3.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kSame = 1e-4;  // [rad]: the file's digits
constexpr const char* kSpace = " \t\r";

struct Entry {
  std::string key;
  std::string value;
};

/// A number with so many decimals; without a minus sign where these are all 0.
std::string number(double value, int digits) {
  std::string text = fmt::format("{:.{}f}", value, digits);
  if (text.find_first_not_of("-0.") == std::string::npos && text.starts_with('-')) text.erase(0, 1);
  return text;
}

std::string turn(const Eigen::Quaterniond& rotation) {
  const Eigen::Vector3d degrees = so3_log(rotation) / kDegree;
  return fmt::format("[{}, {}, {}]", number(degrees.x(), 3), number(degrees.y(), 3), number(degrees.z(), 3));
}

std::vector<Entry> entries_of(const RigCalibration& calibration, bool has_imu) {
  std::vector<Entry> entries = {
      {"camera", turn(calibration.head_from_camera * nominal_head_from_camera().conjugate())}};
  if (has_imu) {
    entries.push_back({"imu", turn(calibration.head_from_imu)});
    entries.push_back({"offset", number(static_cast<double>(calibration.offset.count()) * 1e-6, 2)});
  }
  return entries;
}

std::vector<std::string> split(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

bool is_blank(const std::string& line) {
  return line.find_first_not_of(kSpace) == std::string::npos;
}

/// The place in a line where the value of `key: value` begins; nothing for another line.
std::optional<size_t> value_of(const std::string& line, const std::string& key, bool indented) {
  const size_t begin = line.find_first_not_of(" \t");
  if (begin == std::string::npos || (begin > 0) != indented || line.compare(begin, key.size(), key) != 0)
    return std::nullopt;
  const size_t colon = line.find_first_not_of(" \t", begin + key.size());
  if (colon == std::string::npos || line[colon] != ':') return std::nullopt;
  return std::min(line.size(), colon + 1);
}

/// The place where the value ends: before a comment and the blanks that precede it, else before those at the
/// end of the line.
size_t end_of_value(const std::string& line, size_t begin) {
  size_t end = line.find(" #", begin);
  if (end == std::string::npos) end = line.size();
  while (end > begin && std::strchr(kSpace, line[end - 1]) != nullptr) --end;
  return end;
}

std::string value_in(const std::string& line, size_t begin) {
  const std::string value = line.substr(begin, end_of_value(line, begin) - begin);
  const size_t first = value.find_first_not_of(kSpace);
  return first == std::string::npos ? "" : value.substr(first);
}

using Lines = std::vector<std::string>;

/// One past the last line that belongs to the mapping that begins at `header`.
size_t end_of_mapping(const Lines& lines, size_t header) {
  size_t end = header + 1;
  for (size_t i = header + 1; i < lines.size(); ++i) {
    if (is_blank(lines[i])) continue;
    if (std::strchr(" \t", lines[i].front()) == nullptr) break;
    end = i + 1;
  }
  return end;
}

/// Into a mapping of one line for each key; false where it is of another form.
bool replace_values(const std::vector<Entry>& entries, size_t header, Lines* lines) {
  std::string indent = "  ";
  const size_t end = end_of_mapping(*lines, header);
  if (header + 1 < end)
    indent = (*lines)[header + 1].substr(0, (*lines)[header + 1].find_first_not_of(" \t"));
  Lines added;
  for (const Entry& entry : entries) {
    bool found = false;
    for (size_t i = header + 1; i < end && !found; ++i) {
      std::string& line = (*lines)[i];
      const auto begin = value_of(line, entry.key, true);
      if (!begin) continue;
      const std::string before = value_in(line, *begin);
      if (before.empty() || (before.front() == '[') != (before.back() == ']')) return false;
      line.replace(*begin, end_of_value(line, *begin) - *begin, " " + entry.value);
      found = true;
    }
    if (!found) added.push_back(indent + entry.key + ": " + entry.value);
  }
  lines->insert(lines->begin() + static_cast<long>(end), added.begin(), added.end());
  return true;
}

Lines block_of(const std::vector<Entry>& entries) {
  Lines block;
  for (const Entry& entry : entries) block.push_back("  " + entry.key + ": " + entry.value);
  return block;
}

/// Ahead of the axes and of the comment above them.
size_t place_for_new(const Lines& lines) {
  size_t place = 0;
  while (place < lines.size() && !value_of(lines[place], "axes", false)) ++place;
  while (place < lines.size() && place > 0 && lines[place - 1].starts_with('#')) --place;
  return place;
}

tl::unexpected<Error> trouble(const fs::path& path, const std::string& what) {
  return fail(ErrorCode::kConfiguration, path.string() + ": " + what);
}

tl::unexpected<Error> system_trouble(const fs::path& path, int error) {
  return trouble(path, std::string("cannot be written: ") + std::strerror(error));
}

fs::path beside(const fs::path& path, const char* ending) {
  return path.string() + ending;
}

/// The file itself, where the path is a link to it.
fs::path target_of(const fs::path& path) {
  std::error_code problem;
  fs::path target = fs::canonical(path, problem);
  return problem ? path : target;
}

Status write_whole(const fs::path& path, const std::string& text) {
  const FileDescriptor file(open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
  if (file.get() < 0) return system_trouble(path, errno);
  for (size_t done = 0; done < text.size();) {
    const ssize_t size = write(file.get(), text.data() + done, text.size() - done);
    if (size < 0 && errno == EINTR) continue;
    if (size < 0) return system_trouble(path, errno);
    done += static_cast<size_t>(size);
  }
  if (fsync(file.get()) != 0) return system_trouble(path, errno);
  return {};
}

/// Reads what is to replace the file.
Status check_says(const fs::path& written, const fs::path& path, const RigConfiguration& before,
                  const RigCalibration& calibration) {
  const auto read = read_rig_configuration(written);
  const bool says =
      read && read->name == before.name &&
      read->calibration.head_from_camera.angularDistance(calibration.head_from_camera) < kSame &&
      (!before.imu || read->calibration.head_from_imu.angularDistance(calibration.head_from_imu) < kSame);
  if (says) return {};
  return trouble(path, "the calibration does not fit into it by itself; write it there by hand");
}

}  // namespace

std::string lines_of(const RigCalibration& calibration, bool has_imu) {
  std::string text = "calibration:\n";
  for (const std::string& line : block_of(entries_of(calibration, has_imu))) text += line + "\n";
  return text;
}

std::string with_calibration(const std::string& text, const RigCalibration& calibration, bool has_imu) {
  const std::vector<Entry> entries = entries_of(calibration, has_imu);
  Lines lines = split(text);
  const auto found = std::find_if(lines.begin(), lines.end(), [](const std::string& line) {
    return value_of(line, "calibration", false).has_value();
  });
  if (found == lines.end()) {
    Lines block = block_of(entries);
    block.insert(block.begin(), "calibration:");
    lines.insert(lines.begin() + static_cast<long>(place_for_new(lines)), block.begin(), block.end());
  } else {
    const auto header = static_cast<size_t>(found - lines.begin());
    const size_t begin = *value_of(*found, "calibration", false);
    if (!value_in(*found, begin).empty() || !replace_values(entries, header, &lines)) {
      std::string& line = lines[header];
      line.erase(begin, end_of_value(line, begin) - begin);
      const auto first = lines.begin() + static_cast<long>(header) + 1;
      const auto after = lines.erase(first, lines.begin() + static_cast<long>(end_of_mapping(lines, header)));
      const Lines block = block_of(entries);
      lines.insert(after, block.begin(), block.end());
    }
  }
  std::string result;
  for (const std::string& line : lines) result += line + "\n";
  return result;
}

Status check_calibration_can_be_written(const fs::path& path) {
  const fs::path target = target_of(path);
  const fs::path probe = beside(target, ".new");
  if (Status written = write_whole(probe, ""); !written) return written;
  std::error_code ignored;
  fs::remove(probe, ignored);
  return {};
}

Status write_calibration(const fs::path& path, const RigCalibration& calibration) {
  const auto before = read_rig_configuration(path);
  if (!before) return tl::unexpected(before.error());
  const fs::path target = target_of(path);
  std::ifstream file(target, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  if (!file) return trouble(path, "cannot be read");
  const fs::path fresh = beside(target, ".new");
  std::error_code problem;
  Status done = write_whole(fresh, with_calibration(text, calibration, before->imu.has_value()));
  if (done) done = check_says(fresh, path, *before, calibration);
  if (done) done = write_whole(beside(target, ".old"), text);
  if (done) {
    fs::permissions(fresh, fs::status(target).permissions(), problem);
    fs::rename(fresh, target, problem);
    if (problem) done = trouble(path, "cannot be replaced: " + problem.message());
  }
  if (!done) fs::remove(fresh, problem);
  return done;
}

}  // namespace cairn
