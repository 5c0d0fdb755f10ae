// SPDX-License-Identifier: Apache-2.0
#include "client/capture/stamp_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace cairn {
namespace {

constexpr size_t kLeastStamps = 10;
constexpr double kSecond = 1e9;  ///< [ns]
constexpr double kDay = 86400 * kSecond;
constexpr double kFastest = 0.004 * kSecond;  ///< steps of cameras: 250 Hz ...
constexpr double kSlowest = kSecond;          ///< ... to one image a second
constexpr double kNoStep = 1e-4 * kSecond;    ///< no camera of any kind is that fast
constexpr double kRegular = 0.25;             ///< of the median: a regular step differs by less
constexpr double kWrap = 4294967296.0;        ///< values of a 32-bit counter

struct Unit {
  TimeUnit unit;
  std::string_view short_name;
  std::string_view long_name;
  double nanoseconds;
};
constexpr std::array kUnits = {
    Unit{TimeUnit::kSeconds, "s", "seconds", 1e9},
    Unit{TimeUnit::kMilliseconds, "ms", "milliseconds", 1e6},
    Unit{TimeUnit::kMicroseconds, "us", "microseconds", 1e3},
    Unit{TimeUnit::kNanoseconds, "ns", "nanoseconds", 1},
};

const Unit& find(TimeUnit unit) {
  return kUnits[static_cast<size_t>(unit)];
}

bool is_of_a_camera(double step) {
  return step >= kFastest && step <= kSlowest;
}

/// All steps, and those forward in ascending order [ns].
struct Steps {
  explicit Steps(std::span<const Timestamp> stamps) {
    for (size_t i = 1; i < stamps.size(); ++i) {
      const int64_t step = (stamps[i] - stamps[i - 1]).count();
      all.push_back(step);
      if (step > 0) forward.push_back(step);
      if (step < 0) back.push_back(i);
    }
    std::sort(forward.begin(), forward.end());
  }
  [[nodiscard]] size_t equal() const { return all.size() - forward.size() - back.size(); }
  [[nodiscard]] double median() const { return static_cast<double>(forward[forward.size() / 2]); }
  [[nodiscard]] bool are_regular() const {
    const auto near = std::count_if(forward.begin(), forward.end(), [&](int64_t step) {
      return std::abs(static_cast<double>(step) - median()) < kRegular * median();
    });
    return static_cast<size_t>(near) * 2 >= all.size() && back.size() * 10 < all.size();
  }

  std::vector<int64_t> all;
  std::vector<int64_t> forward;
  std::vector<size_t> back;  ///< places of stamps that lie before the one before them
};

/// Says what may have made stamps equal. It shows in the greatest common divisor of the steps forward.
std::string why_equal(const Steps& steps, Timestamp first, const Unit& unit) {
  const int64_t common = std::accumulate(steps.forward.begin(), steps.forward.end(), int64_t{0},
                                         [](int64_t a, int64_t b) { return std::gcd(a, b); });
  const double quantum = static_cast<double>(common);
  const double in_units = quantum / unit.nanoseconds;
  const bool is_power_of_two = std::exp2(std::round(std::log2(in_units))) == in_units;
  if (common == 0 && first.nanoseconds % static_cast<int64_t>(kSecond) == 0)
    return "all are the same whole second: the decimals are lost, or they went through 32-bit numbers";
  if (common == 0) return "all are the same";
  if (quantum == kSecond) return "these are whole seconds: the decimals are lost";
  if (static_cast<double>(steps.forward.back()) < kNoStep && unit.unit == TimeUnit::kSeconds) {
    return "these may be days, as spreadsheets count, with too few decimals";
  }
  if (in_units >= 64 && is_power_of_two) {
    return fmt::format("all differ by multiples of {:g} {}: they went through 32-bit numbers", in_units,
                       unit.short_name);
  }
  return fmt::format("all differ by multiples of {:g} s: digits are lost, as in a spreadsheet",
                     quantum / kSecond);
}

std::string count_text(size_t part, size_t whole) {
  return fmt::format("{} of {}", part, whole);
}

struct Impossible {
  std::string why;
  std::string remedy;
};

std::optional<Impossible> why_impossible(std::span<const Timestamp> stamps, const Steps& steps,
                                         TimeUnit unit) {
  const Unit& read = find(unit);
  if (2 * steps.equal() > steps.all.size()) {
    return Impossible{
        fmt::format("{} stamps are equal to the one before, which no camera has: {}",
                    count_text(steps.equal(), steps.all.size() + 1), why_equal(steps, stamps.front(), read)),
        "export the times with all their digits"};
  }
  if (steps.forward.empty()) return std::nullopt;  // all go back
  const double median = steps.median();
  const auto said = fmt::format("the median step of the stamps, read as {}, is {:.3g} s, which no camera has",
                                read.long_name, median / kSecond);
  if (median >= kNoStep && (median <= kSlowest || !steps.are_regular())) return std::nullopt;
  for (const Unit& other : kUnits) {
    const double step = median / read.nanoseconds * other.nanoseconds;
    if (other.unit == unit || !is_of_a_camera(step)) continue;
    return Impossible{fmt::format("{}; as {} it is {:.3g} s", said, other.long_name, step / kSecond),
                      fmt::format("add unit={} to the source (unit={} takes the stamps as they are)",
                                  other.short_name, read.short_name)};
  }
  if (unit == TimeUnit::kSeconds && is_of_a_camera(median / kSecond * kDay)) {
    return Impossible{said + "; these may be days, as spreadsheets count", "multiply by 86400"};
  }
  if (median < kNoStep) return Impossible{said, "write the times of capture in seconds"};
  return std::nullopt;
}

/// ", as ... does" where stamps go back by what a 32-bit counter holds.
std::string why_back(const Steps& steps) {
  for (const Unit& counted : kUnits) {
    const double wrap = kWrap * counted.nanoseconds;
    const auto is_wrap = [&](size_t at) {
      const double back = -static_cast<double>(steps.all[at - 1]);
      return std::abs(back + (steps.forward.empty() ? 0 : steps.median()) - wrap) < 0.01 * wrap;
    };
    if (std::all_of(steps.back.begin(), steps.back.end(), is_wrap))
      return fmt::format(", as a 32-bit counter does that begins again after {:.4g} s", wrap / kSecond);
  }
  return "";
}

}  // namespace

std::string_view short_name(TimeUnit unit) {
  return find(unit).short_name;
}

std::string_view long_name(TimeUnit unit) {
  return find(unit).long_name;
}

StampReport check_stamps(std::span<const Timestamp> stamps, TimeUnit unit) {
  const Steps steps(stamps);
  StampReport report;
  if (!steps.back.empty()) {
    report.remarks.push_back(
        fmt::format("{} stamps go back, stamp {} as the first{}: each is taken for a cut",
                    count_text(steps.back.size(), stamps.size()), steps.back.front() + 1, why_back(steps)));
  }
  if (stamps.size() < kLeastStamps) return report;
  if (auto found = why_impossible(stamps, steps, unit)) {
    report.impossible = std::move(found->why);
    report.remedy = std::move(found->remedy);
  }
  if (!steps.forward.empty() && steps.median() > kSlowest) {
    report.remarks.push_back(
        fmt::format("the median step of the stamps is {:.3g} s: between images that far apart no motion can "
                    "be followed",
                    steps.median() / kSecond));
  }
  return report;
}

}  // namespace cairn
