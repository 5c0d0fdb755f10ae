// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/time.h"

namespace cairn {

/// The unit in which a list of stamps counts.
enum class TimeUnit : uint8_t { kSeconds, kMilliseconds, kMicroseconds, kNanoseconds };

/// The unit's name in `unit=` of a source: s, ms, us, ns.
[[nodiscard]] std::string_view short_name(TimeUnit unit);
/// The unit's name in a sentence: seconds, milliseconds, ...
[[nodiscard]] std::string_view long_name(TimeUnit unit);

struct StampReport {
  /// Why no camera has such stamps, with the likely cause. A sentence about what they are from.
  std::optional<std::string> impossible;
  /// What to do about it where the stamps are from a list: the sentence's end.
  std::string remedy;
  /// Sentences about what recordings do have and a person should know.
  std::vector<std::string> remarks;
};

/// Looks at the steps between stamps that were read as `unit`. Impossible: most steps are 0 (whole seconds,
/// 32-bit floats, a spreadsheet's rounding), or they are regular and their median is that of a camera in
/// another unit only. Remarks: steps over a second (stills), stamps that go back (a counter that wraps among
/// them). A list of fewer than ten says nothing of its unit.
[[nodiscard]] StampReport check_stamps(std::span<const Timestamp> stamps, TimeUnit unit);

}  // namespace cairn
