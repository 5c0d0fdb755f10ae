// SPDX-License-Identifier: Apache-2.0
#include "common/base/option_list.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <set>
#include <type_traits>

#include "common/base/overloaded.h"

namespace cairn {
namespace {

double as_number(const OptionList::Value& value) {
  return std::visit(
      Overloaded{[](const std::chrono::milliseconds* ms) { return static_cast<double>(ms->count()); },
                 [](const auto* number) { return static_cast<double>(*number); }},
      value);
}

/// Both ends are rounded to the option's own type: 0.01 is more than the nearest float, which is printed as
/// 0.01, too. NaN is in no range.
bool is_within(const OptionList::Range& range, const OptionList::Value& value) {
  return std::visit(Overloaded{[&](const float* number) {
                                 return *number >= static_cast<float>(range.least) &&
                                        *number <= static_cast<float>(range.most);
                               },
                               [&](const auto* /*number*/) {
                                 return as_number(value) >= range.least && as_number(value) <= range.most;
                               }},
                    value);
}

template <typename Number>
bool parse(const std::string& text, Number* value) {
  Number parsed{};
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), parsed);
  if (problem != std::errc() || end != text.data() + text.size()) return false;
  *value = parsed;
  return true;
}

bool parse(const std::string& text, bool* value) {
  if (text != "true" && text != "false") return false;
  *value = text == "true";
  return true;
}

bool parse(const std::string& text, std::chrono::milliseconds* value) {
  int64_t count = 0;
  if (!parse(text, &count)) return false;
  *value = std::chrono::milliseconds(count);
  return true;
}

std::string unit_after(const OptionList::Row& row) {
  return row.unit.empty() ? "" : " [" + row.unit + "]";
}

}  // namespace

OptionList& OptionList::add(std::string name, bool* value) {
  rows_.push_back({std::move(name), value, {0, 1}, {}});
  return *this;
}

OptionList& OptionList::add(std::string name, Value value, Range range, std::string unit) {
  rows_.push_back({std::move(name), value, range, std::move(unit)});
  return *this;
}

OptionList& OptionList::add_part(std::string name, OptionList part) {
  parts_.emplace_back(std::move(name), std::move(part));
  return *this;
}

OptionList& OptionList::add_order(std::string smaller, std::string larger) {
  orders_.emplace_back(std::move(smaller), std::move(larger));
  return *this;
}

std::vector<std::string> OptionList::names() const {
  std::vector<std::string> names;
  for (const Row& row : rows_) names.push_back(row.name);
  for (const auto& [name, part] : parts_) names.push_back(name);
  return names;
}

const OptionList::Row* OptionList::find_row(const std::string& name) const {
  if (const size_t dot = name.find('.'); dot != std::string::npos) {
    const OptionList* part = find_part(name.substr(0, dot));
    return part == nullptr ? nullptr : part->find_row(name.substr(dot + 1));
  }
  const auto found =
      std::find_if(rows_.begin(), rows_.end(), [&](const Row& row) { return row.name == name; });
  return found == rows_.end() ? nullptr : &*found;
}

const OptionList* OptionList::find_part(const std::string& name) const {
  const auto found =
      std::find_if(parts_.begin(), parts_.end(), [&](const auto& part) { return part.first == name; });
  return found == parts_.end() ? nullptr : &found->second;
}

Status OptionList::check() const {
  for (const Row& row : rows_) {
    if (is_within(row.range, row.value)) continue;
    return fail(ErrorCode::kConfiguration,
                fmt::format("{} is {}: expected {} to {}{}", row.name, option_text(row), row.range.least,
                            row.range.most, unit_after(row)));
  }
  for (const auto& [name, part] : parts_) {
    if (const Status checked = part.check(); !checked)
      return fail(checked.error().code, name + "." + checked.error().message);
  }
  for (const auto& [smaller, larger] : orders_) {
    const Row& low = *find_row(smaller);
    const Row& high = *find_row(larger);
    if (as_number(low.value) <= as_number(high.value)) continue;
    return fail(ErrorCode::kConfiguration, fmt::format("{} is {}, more than {}, which is {}", smaller,
                                                       option_text(low), larger, option_text(high)));
  }
  return {};
}

Status OptionList::check_complete() const {
  std::set<const void*> listed;
  for (const Row& row : rows_) std::visit([&](const auto* value) { listed.insert(value); }, row.value);
  if (listed.size() != rows_.size()) return fail(ErrorCode::kInternal, "one member is listed as two options");
  if (const size_t count = rows_.size() + parts_.size(); members_ != 0 && count != members_) {
    return fail(ErrorCode::kInternal,
                fmt::format("{} options and parts are listed, the struct has {}", count, members_));
  }
  for (const auto& [name, part] : parts_) {
    if (part.members_ == 0) return fail(ErrorCode::kInternal, name + ": its members are not counted");
    if (const Status checked = part.check_complete(); !checked)
      return fail(checked.error().code, name + ": " + checked.error().message);
  }
  return {};
}

std::string option_text(const OptionList::Row& row) {
  return std::visit(
      Overloaded{[](const std::chrono::milliseconds* ms) { return fmt::format("{}", ms->count()); },
                 // As many digits as it takes to read the same number again.
                 [](const auto* value) { return fmt::format("{}", *value); }},
      row.value);
}

Status set_option(const OptionList::Row& row, const std::string& text) {
  const bool is_set = std::visit([&](auto* value) { return parse(text, value); }, row.value);
  if (is_set) return {};
  const bool is_switch = std::holds_alternative<bool*>(row.value);
  const bool is_real =
      std::holds_alternative<float*>(row.value) || std::holds_alternative<double*>(row.value);
  const char* kind = is_switch ? "true or false" : is_real ? "a number" : "a whole number";
  return fail(ErrorCode::kConfiguration, fmt::format("{} '{}': expected {}", row.name, text, kind));
}

}  // namespace cairn
