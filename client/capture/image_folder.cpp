// SPDX-License-Identifier: Apache-2.0
#include "client/capture/image_folder.h"

#include <fmt/format.h>
#include <fnmatch.h>

#include <algorithm>
#include <map>
#include <set>

#include "common/io/image_header.h"
#include "common/io/text.h"

namespace cairn {
namespace {

bool is_digit(char c) {
  return c >= '0' && c <= '9';
}

/// Cuts a run of digits, without leading zeros, off the front of `text`.
std::string_view take_digits(std::string_view& text) {
  const auto end = static_cast<size_t>(std::find_if_not(text.begin(), text.end(), is_digit) - text.begin());
  auto digits = text.substr(0, end);
  text.remove_prefix(end);
  digits.remove_prefix(std::min(digits.find_first_not_of('0'), digits.size()));
  return digits;
}

std::string in_lower_case(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

bool is_image_name(const std::filesystem::path& path) {
  const auto extension = in_lower_case(path.extension().string());
  return extension == ".png" || extension == ".jpg" || extension == ".jpeg" || extension == ".pgm" ||
         extension == ".ppm";
}

/// A name without its numbers, and these.
struct NumberedName {
  explicit NumberedName(std::string_view name) {
    while (!name.empty()) {
      if (is_digit(name.front())) {
        numbers += take_digits(name);
        numbers += ' ';
        pattern += '*';
      } else {
        pattern += name.front();
        name.remove_prefix(1);
      }
    }
  }
  std::string pattern;
  std::string numbers;
};

bool matches(const std::string& glob, const std::filesystem::path& path) {
  return fnmatch(glob.c_str(), path.filename().c_str(), FNM_CASEFOLD) == 0;
}

/// A short glob for this kind and no other.
std::string glob_of(const ImageKind& kind, const std::vector<ImageKind>& kinds) {
  std::string stricter = kind.pattern;
  if (const size_t last = stricter.rfind('*'); last != std::string::npos) stricter.insert(last + 1, "[0-9]");
  for (const std::string& glob : {kind.pattern, stricter}) {
    const auto names_one = std::count_if(kinds.begin(), kinds.end(), [&](const ImageKind& other) {
      return matches(glob, other.files.front());
    });
    if (names_one == 1 && matches(glob, kind.files.front())) return glob;
  }
  return kind.pattern;
}

std::string kinds_text(const std::vector<ImageKind>& kinds) {
  constexpr size_t kMostNamed = 4;
  std::string text;
  for (size_t i = 0; i < std::min(kinds.size(), kMostNamed); ++i) {
    const auto& file = kinds[i].files.front();
    text += fmt::format("{}{} like {}", i == 0 ? "" : ", ", kinds[i].files.size(), file.filename().string());
    const auto content = read_file(file);
    if (!content) continue;
    const auto header =
        read_image_header({reinterpret_cast<const uint8_t*>(content->data()), content->size()});
    if (header) text += fmt::format(" ({}x{}, {} bits)", header->width, header->height, header->bits);
  }
  return text + (kinds.size() > kMostNamed ? ", and others" : "");
}

}  // namespace

bool natural_less(std::string_view a, std::string_view b) {
  const std::string_view whole_a = a;
  const std::string_view whole_b = b;
  while (!a.empty() && !b.empty()) {
    if (is_digit(a.front()) && is_digit(b.front())) {
      const auto digits_a = take_digits(a);
      const auto digits_b = take_digits(b);
      if (digits_a.size() != digits_b.size()) return digits_a.size() < digits_b.size();
      if (digits_a != digits_b) return digits_a < digits_b;
      continue;
    }
    if (a.front() != b.front()) return a.front() < b.front();
    a.remove_prefix(1);
    b.remove_prefix(1);
  }
  if (a.empty() != b.empty()) return a.empty();
  return whole_a < whole_b;  // equal but for leading zeros
}

bool is_hidden(const std::filesystem::path& path) {
  return path.filename().string().starts_with('.');
}

std::vector<ImageKind> kinds_side_by_side(const std::vector<std::filesystem::path>& paths) {
  struct Group {
    ImageKind kind;
    std::set<std::string> numbers;
  };
  std::map<std::string, Group> groups;
  for (const auto& path : paths) {
    NumberedName name(path.filename().string());
    auto& group = groups[in_lower_case(name.pattern)];
    if (group.kind.files.empty()) group.kind.pattern = std::move(name.pattern);
    group.kind.files.push_back(path);
    group.numbers.insert(std::move(name.numbers));
  }
  if (groups.size() < 2) return {};
  const auto& largest = std::max_element(groups.begin(), groups.end(), [](const auto& a, const auto& b) {
                          return a.second.kind.files.size() < b.second.kind.files.size();
                        })->second;
  std::vector<ImageKind> kinds;
  for (const auto& [pattern, group] : groups) {
    const auto shared = std::count_if(group.numbers.begin(), group.numbers.end(),
                                      [&](const auto& number) { return largest.numbers.contains(number); });
    if (shared >= 2 && static_cast<size_t>(shared) * 2 >= group.kind.files.size())
      kinds.push_back(group.kind);
  }
  return kinds.size() < 2 ? std::vector<ImageKind>() : kinds;
}

Result<ImageFolder> list_images(const std::filesystem::path& directory,
                                const std::optional<std::string>& glob) {
  std::error_code error;
  if (!std::filesystem::exists(directory, error)) {
    return fail(ErrorCode::kNotFound, directory.string() + ": no such directory");
  }
  ImageFolder folder;
  for (std::filesystem::directory_iterator at(directory, error), end; !error && at != end;
       at.increment(error)) {
    if (!is_image_name(at->path()) || (glob && !matches(*glob, at->path()))) continue;
    if (is_hidden(at->path())) {
      ++folder.hidden;
    } else {
      folder.files.push_back(at->path());
    }
  }
  if (error) return fail(ErrorCode::kIo, directory.string() + ": cannot be listed: " + error.message());
  if (folder.files.empty()) {
    return fail(ErrorCode::kNotFound, directory.string() + ": no png, jpg, jpeg, pgm or ppm file in it" +
                                          (glob ? " matches " + in_quotes(*glob) : ""));
  }
  std::sort(folder.files.begin(), folder.files.end(), [](const auto& a, const auto& b) {
    return natural_less(a.filename().string(), b.filename().string());
  });
  const auto kinds = glob ? std::vector<ImageKind>() : kinds_side_by_side(folder.files);
  if (kinds.empty()) return folder;
  return fail(ErrorCode::kConfiguration,
              fmt::format("{}: images of {} kinds lie side by side: {}; choose one with match=, for example "
                          "\"images:{}?match={}\" (match=* takes all of them as frames)",
                          directory.string(), kinds.size(), kinds_text(kinds), directory.string(),
                          glob_of(kinds.front(), kinds)));
}

}  // namespace cairn
