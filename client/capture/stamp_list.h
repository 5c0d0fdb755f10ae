// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string_view>
#include <vector>

#include "client/capture/frame_source.h"
#include "client/capture/source_uri.h"
#include "client/capture/stamp_check.h"

namespace cairn {

/// The unit in which a source's list of times counts, and whether its option `unit=s|ms|us|ns` says so.
struct StampUnit {
  TimeUnit unit = TimeUnit::kSeconds;
  bool is_given = false;
};
/// The unit of a source's option, `otherwise` where it has none. kUsage for a unit that there is not.
[[nodiscard]] Result<StampUnit> stamp_unit(const SourceUri& uri, TimeUnit otherwise);

/// A decimal number of `unit`, exact to the nanosecond; nanoseconds are whole numbers.
[[nodiscard]] std::optional<Timestamp> parse_stamp(std::string_view text, TimeUnit unit);
/// "; as milliseconds it would be a time of our years: add unit=ms to the source" for a text that
/// parse_stamp() does not take and another unit explains, else nothing.
[[nodiscard]] std::string other_unit_hint(std::string_view text, TimeUnit unit);

/// Reads a list with one time a line. Errors: those of read_text_file(); kDamaged (a line that is no time, no
/// line at all).
[[nodiscard]] Result<std::vector<Timestamp>> read_times(const std::filesystem::path& path, TimeUnit unit);

/// Notes for a person about the stamps in `list`. kDamaged where no camera can have them, unless the unit was
/// given: whoever gave it has looked.
[[nodiscard]] Result<std::vector<SourceNote>> vet_stamps(const std::filesystem::path& list,
                                                         std::span<const Timestamp> stamps, StampUnit unit);

}  // namespace cairn
