// SPDX-License-Identifier: Apache-2.0
#include "client/capture/imu_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <initializer_list>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "common/base/median.h"
#include "common/io/text.h"

namespace cairn {
namespace {

constexpr size_t kFields = 7;
constexpr size_t kNanosecondDigits = 16;
constexpr double kLeastGravity = 7;   // [m/s^2] median of the accelerations of an IMU that is carried about
constexpr double kMostGravity = 13;   // likewise
constexpr double kGravity = 9.80665;  // likewise
// [rad/s] More than a turn a second all the time, or more than small gyros can measure (2000 degrees/s about
// each axis).
constexpr double kMostMedianRate = 6.3;
constexpr double kMostRate = 61;
constexpr double kMostStep = 0.05;   // [s]
constexpr double kLeastStep = 1e-4;  // [s]: no IMU is quicker
// [ns] As of parse_timestamp(): the difference of any two fits, too.
constexpr int64_t kMostTime = std::numeric_limits<int64_t>::max() / 2;

struct Row {
  Timestamp time;
  std::array<Eigen::Vector3d, 2> triples;
};

bool is_nanoseconds(std::string_view text) {
  return text.size() >= kNanosecondDigits && text.find_first_not_of("0123456789") == std::string_view::npos;
}

std::optional<Timestamp> parse_time(std::string_view text) {
  if (!is_nanoseconds(text)) return parse_timestamp(text);
  int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || value > kMostTime) return std::nullopt;
  return Timestamp{value};
}

/// Seven numbers, the first of which is no time.
bool is_row_of_no_time(std::string_view line) {
  const auto fields = split_fields(line);
  return fields.size() == kFields && !parse_time(fields[0]) &&
         std::all_of(fields.begin(), fields.end(),
                     [](std::string_view field) { return parse_number(field).has_value(); });
}

std::optional<Row> parse_row(std::string_view line) {
  const auto fields = split_fields(line);
  if (fields.size() != kFields) return std::nullopt;
  const auto time = parse_time(fields[0]);
  if (!time) return std::nullopt;
  Row row{*time, {}};
  for (size_t i = 0; i + 1 < kFields; ++i) {
    const auto number = parse_number(fields[i + 1]);
    if (!number) return std::nullopt;
    row.triples[i / 3][static_cast<int>(i % 3)] = *number;
  }
  return row;
}

/// "x" or "_RS_S_x", as it follows the letter of a quantity.
bool is_axis(std::string_view text) {
  if (text.empty() || std::string_view("xyz").find(text.back()) == std::string_view::npos) return false;
  return text.size() == 1 || text.front() == '_' || text.front() == '.';
}

bool has_any(std::string_view text, std::initializer_list<std::string_view> parts) {
  return std::any_of(parts.begin(), parts.end(),
                     [text](std::string_view part) { return text.find(part) != std::string_view::npos; });
}

/// 0: the name of a column of accelerations; 1: of rates of turn; nothing: of neither, or who knows.
std::optional<size_t> quantity_of(std::string_view name) {
  std::string word;
  for (const char c : name) {
    if (std::isalpha(static_cast<unsigned char>(c)) != 0 || !word.empty())
      word += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  while (!word.empty() && std::isalpha(static_cast<unsigned char>(word.back())) == 0) word.pop_back();
  if (word.empty()) return std::nullopt;
  const bool by_letter = is_axis(std::string_view(word).substr(1));
  const bool is_rate = has_any(word, {"gyr", "omega", "ang", "rate", "rot"}) ||
                       (by_letter && std::string_view("wgro").find(word.front()) != std::string_view::npos);
  const bool is_acceleration = has_any(word, {"acc"}) || (by_letter && word.front() == 'a');
  if (is_rate == is_acceleration) return std::nullopt;
  return is_rate ? 1 : 0;
}

/// 0 or 1: the three columns that the heading calls accelerations; nothing where there is none that tells.
std::optional<size_t> named_accelerations(std::string_view content) {
  for (const TextLine& line : all_lines(content)) {
    if (is_blank(line.text)) continue;
    const auto text = line.text.front() == '#' ? trim(line.text.substr(1)) : line.text;
    if (!is_heading(text)) return std::nullopt;
    // "timestamp [ns],w_RS_S_x [rad s^-1],..." has more fields between blanks than columns.
    const size_t comma = text.find(',');
    const bool has_commas = comma != std::string_view::npos;
    const auto words = split_fields(has_commas ? text.substr(comma) : text);
    const size_t second = has_commas ? 0 : 1;
    if (words.size() <= second) continue;
    if (const auto quantity = quantity_of(words[second])) return quantity;
  }
  return std::nullopt;
}

double median_length(const std::vector<Row>& rows, size_t triple) {
  std::vector<double> lengths;
  lengths.reserve(rows.size());
  for (const Row& row : rows) lengths.push_back(row.triples[triple].norm());
  return reorder_to_median(std::span(lengths));
}

bool is_gravity(double length) {
  return length >= kLeastGravity && length <= kMostGravity;
}

Result<size_t> find_accelerations(const std::filesystem::path& path, std::string_view content,
                                  const std::vector<Row>& rows) {
  const std::array<double, 2> lengths = {median_length(rows, 0), median_length(rows, 1)};
  const auto named = named_accelerations(content);
  if (named && is_gravity(lengths[*named])) return *named;
  if (!named && is_gravity(lengths[0]) != is_gravity(lengths[1])) return is_gravity(lengths[0]) ? 0 : 1;
  const double found = lengths[named.value_or(0)];
  const bool in_g = is_gravity(kGravity * found);
  return fail(
      ErrorCode::kDamaged,
      fmt::format("{}: {} have a length of {:.3g} in the median, which has no gravity (9.8 m/s^2) in it{}",
                  path.string(), named ? "its accelerations" : "neither its first nor its last three columns",
                  found,
                  in_g ? "; they are in g, it seems: multiply them by 9.80665"
                       : "; rows `time wx wy wz ax ay az` in rad/s and m/s^2 are needed"));
}

Status vet(const std::filesystem::path& path, const std::vector<ImuSample>& samples) {
  std::vector<double> rates;
  std::vector<double> steps;
  for (size_t i = 0; i < samples.size(); ++i) {
    rates.push_back(samples[i].rate.norm());
    if (i > 0) steps.push_back(seconds_between(samples[i].time, samples[i - 1].time));
  }
  const double fastest = *std::max_element(rates.begin(), rates.end());
  if (reorder_to_median(std::span(rates)) > kMostMedianRate || fastest > kMostRate) {
    return fail(ErrorCode::kDamaged,
                fmt::format("{}: rates of turn of up to {:.3g} rad/s; they are in degrees "
                            "a second, it seems: multiply them by 0.0174533",
                            path.string(), fastest));
  }
  const double step = reorder_to_median(std::span(steps));
  if (step < kLeastStep) {
    return fail(ErrorCode::kDamaged,
                fmt::format("{}: a sample every {:.3g} s, which is no IMU's; times of 16 "
                            "digits or more are ns: give them in ns or s",
                            path.string(), step));
  }
  if (step > kMostStep) {
    return fail(ErrorCode::kDamaged,
                fmt::format("{}: a sample every {:.3g} s; 20 a second or more are needed, "
                            "with times in ns or s",
                            path.string(), step));
  }
  return {};
}

}  // namespace

Result<std::vector<ImuSample>> read_imu_file(const std::filesystem::path& path) {
  const auto content = read_text_file(path);
  if (!content) return tl::unexpected(content.error());
  std::vector<Row> rows;
  for (const TextLine& line : table_rows(*content)) {
    const auto row = parse_row(line.text);
    if (!row && is_row_of_no_time(line.text)) {
      return fail(
          ErrorCode::kDamaged,
          at_line(path, line.number,
                  "its time is more than 146 years from 1970; times are seconds, or nanoseconds with 16 "
                  "digits or more"));
    }
    if (!row) {
      return fail(ErrorCode::kDamaged,
                  at_line(path, line.number, "not a row `time wx wy wz ax ay az` of seven numbers"));
    }
    if (!rows.empty() && row->time < rows.back().time) {
      return fail(ErrorCode::kDamaged,
                  at_line(path, line.number, "time goes back; sort the rows by time, one recording a file"));
    }
    if (rows.empty() || row->time > rows.back().time) rows.push_back(*row);
  }
  if (rows.size() < 2)
    return fail(ErrorCode::kDamaged, path.string() + ": has no rows `time wx wy wz ax ay az`");
  const auto accelerations = find_accelerations(path, *content, rows);
  if (!accelerations) return tl::unexpected(accelerations.error());
  std::vector<ImuSample> samples;
  samples.reserve(rows.size());
  for (const Row& row : rows)
    samples.push_back({row.time, row.triples[1 - *accelerations], row.triples[*accelerations]});
  if (auto status = vet(path, samples); !status) return tl::unexpected(status.error());
  return samples;
}

}  // namespace cairn
