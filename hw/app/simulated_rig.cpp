// SPDX-License-Identifier: Apache-2.0
#include "hw/app/simulated_rig.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>
#include <sstream>
#include <utility>

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kBeyondLimits = 2 * kDegree;  // the hard stops lie so far outside of the hard limits
constexpr double kLongest = 1e6;               // [s]
constexpr double kSlowestGait = 0.2;           // [Hz]
constexpr double kFastestGait = 3;
constexpr double kFastestWay = 60;  // [deg/s] around the point
constexpr double kTurnTime = 1.2;   // [s]
constexpr double kQuickestTurn = 0.2;
constexpr double kSpareFriction = 1.2;  // over what the configuration says at least

constexpr std::array<std::pair<std::string_view, DeviceFault>, 10> kFaults = {{
    {"reset-pan", DeviceFault::kResetPan},
    {"reset-tilt", DeviceFault::kResetTilt},
    {"stuck-pan", DeviceFault::kStuckPan},
    {"stuck-tilt", DeviceFault::kStuckTilt},
    {"mute-pan", DeviceFault::kMutePan},
    {"mute-tilt", DeviceFault::kMuteTilt},
    {"mute-imu", DeviceFault::kMuteImu},
    {"imu-rate", DeviceFault::kImuRate},
    {"drop", DeviceFault::kDrop},
    {"bus-off", DeviceFault::kBusOff},
}};

std::string_view name_of(DeviceFault fault) {
  const auto* found =
      std::find_if(kFaults.begin(), kFaults.end(), [&](const auto& known) { return known.second == fault; });
  return found->first;
}

std::string name_of(odrive::AxisState state) {
  switch (state) {
    case odrive::AxisState::kIdle:
      return "idle";
    case odrive::AxisState::kClosedLoop:
      return "closed-loop";
    case odrive::AxisState::kHoming:
      return "homing";
    default:
      return "state " + std::to_string(static_cast<uint32_t>(state));
  }
}

std::optional<milliseconds> to_time(std::string_view text) {
  double seconds = 0;
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), seconds);
  const bool whole = problem == std::errc() && end == text.data() + text.size();
  if (!whole || !(seconds >= 0 && seconds <= kLongest)) return std::nullopt;
  return milliseconds(std::llround(seconds * 1000));
}

/// The rest of the line as numbers; nothing where a word is none.
std::optional<std::vector<double>> read_numbers(std::istringstream& words) {
  std::vector<double> numbers;
  for (double number = 0; words >> number;) numbers.push_back(number);
  if (!words.eof()) return std::nullopt;
  return numbers;
}

/// The plant of a motor that turns the other way has the axis's angle negated.
double side(const AxisConfiguration& axis) {
  return axis.turns_per_radian < 0 ? -1 : 1;
}

std::vector<simulated::DriveOptions> drives_of(const RigConfiguration& configuration) {
  std::vector<simulated::DriveOptions> drives;
  for (const AxisConfiguration& axis : configuration.axes) {
    const auto [low, high] = std::minmax({side(axis) * axis.limits.low, side(axis) * axis.limits.high});
    simulated::DriveOptions drive;
    drive.node = axis.node;
    drive.plant.turns_per_radian = std::abs(axis.turns_per_radian);
    drive.plant.low_stop = low - kBeyondLimits;
    drive.plant.high_stop = high + kBeyondLimits;
    drive.plant.start = side(axis) * axis.neutral;
    drive.plant.friction = kSpareFriction * axis.limits.coasting * std::abs(axis.turns_per_radian);
    drive.switch_angle = side(axis) * axis.home;
    drive.position_gain = 1 / axis.limits.reaction;
    drives.push_back(drive);
  }
  return drives;
}

simulated::ImuOptions imu_of(const RigConfiguration& configuration) {
  simulated::ImuOptions imu;
  if (configuration.imu) imu.frequency = configuration.imu->rate;
  return imu;
}

}  // namespace

std::string list_of_device_faults() {
  std::string list;
  for (const auto& [word, fault] : kFaults) list.append(list.empty() ? "" : ", ").append(word);
  return list;
}

Result<TimedFault> parse_timed_fault(std::string_view text) {
  const size_t at = text.find('@');
  const std::string_view word = text.substr(0, at);
  const auto* found =
      std::find_if(kFaults.begin(), kFaults.end(), [&](const auto& known) { return known.first == word; });
  if (found == kFaults.end()) {
    return fail(ErrorCode::kUsage, fmt::format("'{}' is no fault of simulated devices; there are {}", word,
                                               list_of_device_faults()));
  }
  const auto refuse = [&] {
    return fail(ErrorCode::kUsage,
                fmt::format("'{}': expected {}@SECONDS or {}@SECONDS+DURATION", text, word, word));
  };
  if (at == std::string_view::npos) return refuse();
  const std::string_view when = text.substr(at + 1);
  const size_t plus = when.find('+');
  const auto begin = to_time(when.substr(0, plus));
  if (!begin) return refuse();
  if (plus == std::string_view::npos) return TimedFault{found->second, *begin, std::nullopt};
  const auto lasts = to_time(when.substr(plus + 1));
  if (!lasts) return refuse();
  return TimedFault{found->second, *begin, lasts};
}

SimulatedRig::SimulatedRig(const RigConfiguration& configuration, const std::vector<TimedFault>& faults,
                           uint32_t seed, MonotonicTime now, Teller tell)
    : configuration_(configuration),
      bus_(drives_of(configuration), imu_of(configuration), seed, now),
      start_(now),
      now_(now),
      tell_(std::move(tell)),
      to_come_(faults) {
  if (!configuration.imu) bus_.imu().mute(true);
  for (const AxisName name : kAxisNames) {
    Seen& seen = seen_.at(static_cast<size_t>(name));
    seen.least = seen.most = angle(name);
  }
}

void SimulatedRig::turn(CanBus& bus, MonotonicTime now) {
  now_ = now;
  const auto passed = std::chrono::duration_cast<milliseconds>(now - start_);
  std::erase_if(to_come_, [&](const TimedFault& fault) {
    const bool due = fault.at <= passed;
    if (due) inject(fault.what, fault.lasts, now);
    return due;
  });
  std::erase_if(to_end_, [&](const TimedFault& fault) {
    const bool due = fault.at <= passed;
    if (due) {
      set(fault.what, false);
      say(fmt::format("fault {} ends", name_of(fault.what)));
    }
    return due;
  });
  while (const auto frame = bus.receive()) (void)bus_.send(frame->frame);
  move_imu();
  bus_.advance(now);
  while (const auto frame = bus_.receive()) (void)bus.send(frame->frame);
  look();
}

void SimulatedRig::inject(DeviceFault what, std::optional<milliseconds> lasts, MonotonicTime now) {
  now_ = now;
  say(fmt::format("fault {}", name_of(what)));
  set(what, true);
  if (lasts)
    to_end_.push_back({what, std::chrono::duration_cast<milliseconds>(now - start_) + *lasts, std::nullopt});
}

Status SimulatedRig::inject(const std::string& line, MonotonicTime now) {
  const size_t plus = line.find('+');
  const auto fault =
      parse_timed_fault(line.substr(0, plus) + "@0" + (plus == std::string::npos ? "" : line.substr(plus)));
  if (!fault) {
    return fail(ErrorCode::kUsage,
                fault.error().message + "; and walk HZ [DEG/S], stand, turn DEGREES [SECONDS]");
  }
  inject(fault->what, fault->lasts, now);
  return {};
}

Status SimulatedRig::obey(const std::string& line, MonotonicTime now) {
  std::istringstream words(line);
  std::string what;
  words >> what;
  const bool is_walk = what == "walk";
  if (!is_walk && what != "turn" && what != "stand") return inject(line, now);
  now_ = now;
  const auto numbers = read_numbers(words);
  if (!numbers || numbers->size() > (what == "stand" ? 0 : 2) || (what != "stand" && numbers->empty()))
    return fail(ErrorCode::kUsage,
                "'" + line + "': expected walk HZ [DEG/S], stand or turn DEGREES [SECONDS]");
  const auto number = [&](size_t i, double otherwise) {
    return i < numbers->size() ? numbers->at(i) : otherwise;
  };
  if (is_walk && !(number(0, 0) >= kSlowestGait && number(0, 0) <= kFastestGait &&
                   std::abs(number(1, 0)) <= kFastestWay))
    return fail(ErrorCode::kUsage, "'" + line + "': a wearer walks at 0.2 to 3 Hz, at 60 deg/s at most");
  if (what == "turn" && !(std::abs(number(0, 0)) <= 360 && number(1, kTurnTime) >= kQuickestTurn))
    return fail(ErrorCode::kUsage,
                "'" + line + "': a wearer turns by 360 degrees at most, within 0.2 s or more");
  if (is_walk) wearer_.walk(number(0, 0), number(1, 0) * kDegree, seconds());
  if (what == "stand") wearer_.stand(seconds());
  if (what == "turn") wearer_.turn(number(0, 0) * kDegree, number(1, kTurnTime), seconds());
  say("wearer: " + line);
  return {};
}

void SimulatedRig::set(DeviceFault what, bool on) {
  switch (what) {
    case DeviceFault::kResetPan:
    case DeviceFault::kResetTilt:
      if (on) bus_.drive(what == DeviceFault::kResetPan ? 0 : 1).reset();
      break;
    case DeviceFault::kStuckPan:
    case DeviceFault::kStuckTilt:
      bus_.drive(what == DeviceFault::kStuckPan ? 0 : 1).block(on);
      break;
    case DeviceFault::kMutePan:
    case DeviceFault::kMuteTilt:
      bus_.drive(what == DeviceFault::kMutePan ? 0 : 1).mute(on);
      break;
    case DeviceFault::kMuteImu:
      bus_.imu().mute(on);
      break;
    case DeviceFault::kImuRate:
      bus_.imu().set_frequency(imu_of(configuration_).frequency * (on ? 1.5 : 1));
      break;
    case DeviceFault::kDrop:
      bus_.drop(on ? 0.4 : 0);
      break;
    case DeviceFault::kBusOff:
      bus_.set_bus_off(on);
      break;
  }
}

/// Moves the IMU with the head, on which it sits.
void SimulatedRig::move_imu() {
  const auto rate_of = [this](size_t axis) {
    return side(configuration_.axes.at(axis)) * bus_.drive(axis).plant().rate();
  };
  const HeadMotion moved = motion_of_head(head(), {rate_of(0), rate_of(1)},
                                          {wearer_.rate(seconds()), wearer_.acceleration(seconds())});
  const Eigen::Quaterniond imu_from_head = configuration_.calibration.head_from_imu.conjugate();
  const Eigen::Vector3d rate = imu_from_head * moved.rate;
  const Eigen::Vector3d pull = imu_from_head * moved.acceleration;
  bus_.imu().move({{rate.x(), rate.y(), rate.z()}, {pull.x(), pull.y(), pull.z()}});
}

PanTilt SimulatedRig::head() {
  return {angle(AxisName::kPan) * kDegree, angle(AxisName::kTilt) * kDegree};
}

SE3 SimulatedRig::world_from_camera() {
  return {wearer_.world_from_base(seconds()) * base_from_head(head()) *
              configuration_.calibration.head_from_camera,
          wearer_.position(seconds())};
}

double SimulatedRig::angle(AxisName name) {
  const auto index = static_cast<size_t>(name);
  return side(configuration_.axes.at(index)) * bus_.drive(index).plant().angle() / kDegree;
}

void SimulatedRig::look() {
  for (const AxisName name : kAxisNames) {
    Seen& seen = seen_.at(static_cast<size_t>(name));
    const double now = angle(name);
    seen.least = std::min(seen.least, now);
    seen.most = std::max(seen.most, now);
    const odrive::AxisState state = bus_.drive(static_cast<size_t>(name)).state();
    if (state == seen.state) continue;
    seen.state = state;
    say(fmt::format("{} {} at {:.2f}", to_string(name), name_of(state), now));
  }
}

void SimulatedRig::tell_extremes() {
  for (const AxisName name : kAxisNames) {
    const Seen& seen = seen_.at(static_cast<size_t>(name));
    say(fmt::format("{} was from {:.2f} to {:.2f}, {}", to_string(name), seen.least, seen.most,
                    bus_.drive(static_cast<size_t>(name)).plant().touched_stop() ? "and at its hard stop"
                                                                                 : "never at its hard stop"));
  }
}

void SimulatedRig::say(const std::string& what) {
  tell_(fmt::format("{:.3f} {}", seconds(), what));
}

}  // namespace cairn
