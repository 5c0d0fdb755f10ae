// SPDX-License-Identifier: Apache-2.0
#include "client/app/viewer/label_file.h"

#include <algorithm>
#include <utility>

#include "common/base/utf8.h"
#include "common/io/text.h"
#include "common/map/label.h"

namespace cairn {
namespace {

/// The rest of a row after its first `count` fields.
std::string_view rest_after(std::string_view row, int count) {
  for (; count > 0; --count) {
    row.remove_prefix(std::min(row.find_first_of(" \t"), row.size()));
    row = trim(row);
  }
  return row;
}

Result<TimedLabel> parse_row(std::string_view row, cv::Size image) {
  const auto fields = split_fields(row);
  const auto time = fields.size() >= 4 ? parse_timestamp(fields[0]) : std::nullopt;
  const auto x = time ? parse_number(fields[1]) : std::nullopt;
  const auto y = x ? parse_number(fields[2]) : std::nullopt;
  if (!y) return fail(ErrorCode::kDamaged, "expected `timestamp x y text`");
  if (!(*x >= 0 && *x < image.width && *y >= 0 && *y < image.height)) {
    return fail(ErrorCode::kDamaged, "the pixel lies outside the image, which is " +
                                         std::to_string(image.width) + "x" + std::to_string(image.height));
  }
  const std::string_view text = rest_after(row, 3);
  if (const auto fault = fault_of_text(text))
    return fail(ErrorCode::kDamaged, "the text " + in_quotes(text) + " is none: " + *fault);
  if (is_invisible(text) || text.size() > kMaxLabelBytes) {
    return fail(ErrorCode::kDamaged, "a text is 1 to " + std::to_string(kMaxLabelBytes) +
                                         " bytes of UTF-8, not " + in_quotes(text));
  }
  return TimedLabel{*time, {static_cast<int>(*x), static_cast<int>(*y)}, std::string(text)};
}

}  // namespace

Result<std::vector<TimedLabel>> read_timed_labels(const std::filesystem::path& path, cv::Size image) {
  const auto content = read_text_file(path);
  if (!content) return tl::unexpected(content.error());
  std::vector<TimedLabel> labels;
  for (const TextLine& line : table_rows(*content)) {
    auto label = parse_row(line.text, image);
    if (!label) return fail(label.error().code, at_line(path, line.number, label.error().message));
    labels.push_back(std::move(*label));
  }
  std::ranges::stable_sort(labels, {}, &TimedLabel::time);
  return labels;
}

}  // namespace cairn
