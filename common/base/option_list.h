// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "common/base/result.h"

namespace cairn {

/// The options of a component by name: one list checks, prints and reads them, so that each option is written
/// down once beside its member. Made of a plain struct by a function `OptionList list_options(XOptions*)`; it
/// holds pointers to the members, and the struct must outlive it. Not for use while frames are processed:
/// components read their structs.
class OptionList {
 public:
  /// An empty list that stands for no struct: a heading for parts.
  OptionList() = default;
  /// An empty list for a struct that has `members` options and parts: member_count(), less the members that
  /// are no option. check_complete() compares.
  explicit OptionList(size_t members) : members_(members) {}

  using Value = std::variant<bool*, int*, uint64_t*, float*, double*, std::chrono::milliseconds*>;
  /// The values that an option may have, both ends included as the option's type has them [unit of the
  /// option].
  struct Range {
    double least = 0;
    double most = 0;
  };
  struct Row {
    std::string name;
    Value value;
    Range range;
    std::string unit;  ///< empty: a pure number
  };

  /// An option; what is switched on or off has no range.
  OptionList& add(std::string name, bool* value);
  OptionList& add(std::string name, Value value, Range range, std::string unit = {});
  /// The options of a part, under its name.
  OptionList& add_part(std::string name, OptionList part);
  /// The option `smaller` must not exceed `larger`; "part.name" is one of a part. Both are added before.
  OptionList& add_order(std::string smaller, std::string larger);

  [[nodiscard]] const std::vector<Row>& rows() const { return rows_; }
  [[nodiscard]] const std::vector<std::pair<std::string, OptionList>>& parts() const { return parts_; }
  [[nodiscard]] std::vector<std::string> names() const;  ///< of options and of parts, in this order
  /// "part.name" is one of a part.
  [[nodiscard]] const Row* find_row(const std::string& name) const;
  [[nodiscard]] const OptionList* find_part(const std::string& name) const;

  /// kConfiguration names the first option out of its range, with its part, its value and the range:
  /// "motion.decay is 2: expected 0 to 1".
  [[nodiscard]] Status check() const;
  /// Whether each member is listed once, in all parts: kInternal names the first part that lacks some, or has
  /// one twice. For tests; a list of no struct has no members.
  [[nodiscard]] Status check_complete() const;

 private:
  size_t members_ = 0;
  std::vector<Row> rows_;
  std::vector<std::pair<std::string, OptionList>> parts_;
  std::vector<std::pair<std::string, std::string>> orders_;
};

/// The value as text that set_option() reads as the same value again.
[[nodiscard]] std::string option_text(const OptionList::Row& row);
/// Sets the value; kConfiguration when the text is no number of its kind. The range is check()'s matter.
[[nodiscard]] Status set_option(const OptionList::Row& row, const std::string& text);

/// Whether all options of a component are in their ranges (OptionList::check).
template <typename Options>
[[nodiscard]] Status check_options(Options options) {
  return list_options(&options).check();
}

}  // namespace cairn
