// SPDX-License-Identifier: Apache-2.0
#include "hw/calibration/calibration_tour.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "common/geometry/se3.h"

namespace cairn {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

constexpr std::array<double, 5> kPans = {-20, -10, 0, 10, 20};  // [deg] about neutral
constexpr std::array<double, 3> kTilts = {-12, 0, 12};
constexpr double kSpare = 1 * kDegree;        // inside of the soft limits
constexpr double kLeastRange = 12 * kDegree;  // that hand_eye.h asks for, and what an axis is off by
constexpr double kSpeed = 15 * kDegree;       // [rad/s] between places: images stay sharp
constexpr double kPull = 2;                   // [1/s]
constexpr double kNear = 0.7 * kDegree;
constexpr double kNearEnough = 0.2 * kDegree;
constexpr double kAtRest = 1.5 * kDegree;  // [rad/s]
constexpr double kSettling = 0.4;          // [s]: longer than stamps may be apart (clock_offset.h)
constexpr size_t kImages = 15;             // of a place
constexpr size_t kFewestImages = 5;
constexpr double kGlance = 4;  // [s] at most for them
constexpr double kShake = 13;  // [s]
constexpr double kShakeRate = 25 * kDegree;
constexpr std::array<double, 2> kShakeFrequencies = {0.9, 1.3};  // [Hz]
constexpr double kShareOfLimit = 0.5;                            // of rate and acceleration
constexpr int kMostShakes = 3;
constexpr double kSharp = 0.003;  // [s]: what a head turns by at 100 deg/s is the backlash

// [s] of patience.
constexpr double kForRig = 3;
constexpr double kForTracker = 10;
constexpr double kForMap = 30;
constexpr double kForHoming = 90;
constexpr double kForPlace = 20;
constexpr double kOfSilence = 5;
constexpr double kOfIdleness = 2;
constexpr double kToObey = 0.5;
constexpr double kSteady = 1;

tl::unexpected<Error> refuse(std::string why) {
  return fail(ErrorCode::kRefused, std::move(why));
}

std::string words_of(const PanTilt& place) {
  return fmt::format("pan {:.0f}, tilt {:.0f}", place.pan / kDegree, place.tilt / kDegree);
}

/// The least and the greatest angle of an axis that the tour may use [rad].
std::pair<double, double> room_of(const AxisConfiguration& axis) {
  const double inside = axis.limits.margin + kSpare;
  return {axis.limits.low + inside, axis.limits.high - inside};
}

Glance mean_of(const std::vector<TourPose>& poses, const PanTilt& angles) {
  Glance glance{angles, Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero()};
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();
  const Eigen::Quaterniond& first = poses.front().map_from_camera;
  for (const TourPose& pose : poses) {
    turn += so3_log(first.conjugate() * pose.map_from_camera) / static_cast<double>(poses.size());
    glance.camera_in_map += pose.camera_in_map / static_cast<double>(poses.size());
  }
  glance.map_from_camera = first * so3_exp(turn);
  return glance;
}

/// A shake of an axis: how fast it turns at most, and how far it comes by that.
struct Swing {
  double rate;   ///< [rad/s]
  double pulse;  ///< [rad/s]: of its phase
  [[nodiscard]] double angle_at(double t) const { return rate / pulse * std::sin(pulse * t); }
  [[nodiscard]] double rate_at(double t) const { return rate * std::cos(pulse * t); }
};

Swing swing_of(const AxisConfiguration& axis, double frequency) {
  const double pulse = 2 * std::numbers::pi * frequency;
  const auto [low, high] = room_of(axis);
  const double room = std::min(high - axis.neutral, axis.neutral - low);
  return {std::min({kShakeRate, kShareOfLimit * axis.limits.rate,
                    kShareOfLimit * axis.limits.acceleration / pulse, std::max(0.0, room) * pulse}),
          pulse};
}

}  // namespace

Result<CalibrationTour> CalibrationTour::plan(const RigConfiguration& configuration, Timestamp now) {
  for (const AxisName name : kAxisNames) {
    const auto [low, high] = room_of(configuration.axis(name));
    if (high - low >= kLeastRange) continue;
    return fail(ErrorCode::kConfiguration,
                fmt::format("axes.{}: {:.0f} degrees between the soft limits, less one on either side, are "
                            "too few to calibrate; {:.0f} are needed",
                            to_string(name), std::max(0.0, high - low) / kDegree, kLeastRange / kDegree));
  }
  const auto along = [&](AxisName name, double off) {
    const AxisConfiguration& axis = configuration.axis(name);
    const auto [low, high] = room_of(axis);
    // Where neutral is near a limit, the places are to the other side of it.
    const double reach = (name == AxisName::kPan ? kPans.back() : kTilts.back()) * kDegree;
    const double middle =
        high - low < 2 * reach ? (low + high) / 2 : std::clamp(axis.neutral, low + reach, high - reach);
    return std::clamp(middle + off * kDegree, low, high);
  };
  std::vector<PanTilt> places;
  for (const double tilt : kTilts) {
    std::array<double, kPans.size()> pans = kPans;
    if (places.size() % 2 == 1) std::reverse(pans.begin(), pans.end());  // to and fro
    for (const double pan : pans)
      places.push_back({along(AxisName::kPan, pan), along(AxisName::kTilt, tilt)});
  }
  return CalibrationTour(configuration, std::move(places), now);
}

CalibrationTour::CalibrationTour(const RigConfiguration& configuration, std::vector<PanTilt> places,
                                 Timestamp now)
    : configuration_(configuration), places_(std::move(places)), entered_(now) {
  say("waiting for the rig and for the tracker of its camera");
}

std::string CalibrationTour::announcement() const {
  const auto [low, high] = std::minmax_element(
      places_.begin(), places_.end(), [](const PanTilt& a, const PanTilt& b) { return a.pan < b.pan; });
  const auto [down, up] = std::minmax_element(
      places_.begin(), places_.end(), [](const PanTilt& a, const PanTilt& b) { return a.tilt < b.tilt; });
  return fmt::format(
      "The axes of {} will be homed, then look at {} places with pan {:.0f} to {:.0f} and tilt {:.0f} to "
      "{:.0f} degrees{}. The base must stand still for two minutes, with nothing in the head's way.",
      configuration_.name, places_.size(), low->pan / kDegree, high->pan / kDegree, down->tilt / kDegree,
      up->tilt / kDegree, configuration_.imu ? ", and be shaken gently for 13 seconds" : "");
}

std::vector<std::string> CalibrationTour::take_words() {
  return std::exchange(words_, {});
}

void CalibrationTour::take(const TourReport& report) {
  report_ = report;
  if (step_ != Step::kGlancing) return;
  look_.angles.pan += report.angles.pan;
  look_.angles.tilt += report.angles.tilt;
  ++look_.reports;
}

void CalibrationTour::see(const TourPose& pose) {
  pose_ = pose;
  has_news_ = true;
  if (!pose.is_tracked) return;
  if (pose.map != map_) {
    if (!glances_.empty())
      say(fmt::format("the tracker is in another map; {} places that were seen before do not count",
                      glances_.size()));
    map_ = pose.map;
    glances_.clear();
    look_.poses.clear();
  }
  if (step_ == Step::kGlancing && pose.when >= entered_) look_.poses.push_back(pose);
  if (step_ == Step::kShaking) rotations_.push_back({pose.when, pose.map_from_camera});
}

void CalibrationTour::sense(const GyroSample& sample) {
  if (step_ == Step::kShaking) gyro_.push_back(sample);
}

void CalibrationTour::enter(Step step, Timestamp now) {
  step_ = step;
  entered_ = now;
  at_place_.reset();
  idle_.reset();
  look_ = {};
}

void CalibrationTour::begin(Timestamp now) {
  if (step_ != Step::kReady) return;
  if (report_->is_homed) return enter(Step::kMoving, now);
  say("homing");
  enter(Step::kHoming, now);
}

/// Checks for what may go wrong in each step that moves.
Status CalibrationTour::look_after(Timestamp now) {
  if (seconds_between(now, report_->when) > kForRig)
    return refuse("the rig says nothing of itself any more; see what its log says");
  if (!report_->trouble.empty() && in_step(now) > kToObey) return refuse(report_->trouble);
  if (seconds_between(now, *heard_) > kOfSilence)
    return refuse("the tracker of the rig's camera fell silent; start it again, then this");
  return {};
}

Result<TourOrder> CalibrationTour::advance(Timestamp now) {
  if (std::exchange(has_news_, false)) heard_ = now;
  const bool tracks = pose_ && pose_->is_tracked && seconds_between(now, *heard_) < kToObey;
  if (!tracks) tracked_.reset();
  if (tracks && !tracked_) tracked_ = now;
  if (step_ == Step::kWaiting) return wait(now);
  if (step_ == Step::kReady || step_ == Step::kOver) return TourOrder{};
  if (step_ != Step::kLeaving) {
    if (Status good = look_after(now); !good) return tl::unexpected(good.error());
  }
  switch (step_) {
    case Step::kHoming:
      return home(now);
    case Step::kGlancing:
      return glance(now);
    case Step::kShaking:
      return shake(now);
    case Step::kLeaving:
      return leave(now);
    default:
      return move(now);
  }
}

Result<TourOrder> CalibrationTour::wait(Timestamp now) {
  const std::string start =
      "start `cairn-track --rig " + configuration_.name + "` on the rig's host, with the rig's camera";
  if (in_step(now) > kForRig && !report_)
    return refuse("the rig says nothing of itself; see what its log says");
  if (in_step(now) > kForRig && !report_->trouble.empty()) return refuse(report_->trouble);
  if (in_step(now) > kForTracker && !heard_)
    return refuse("no tracker speaks to rig " + configuration_.name + "; " + start);
  if (heard_ && seconds_between(now, *heard_) > kForTracker)
    return refuse("the tracker of the rig's camera fell silent; " + start);
  if (in_step(now) > kForMap && !tracked_)
    return refuse(
        "the tracker of the rig's camera has no map where it looks; turn the rig to where there is one, or "
        "let the tracker make one from where the rig is to stand, and put it there");
  const bool is_steady = tracked_ && seconds_between(now, *tracked_) > kSteady;
  if (is_steady && report_ && report_->trouble.empty() && in_step(now) > kSteady) enter(Step::kReady, now);
  return TourOrder{};
}

Result<TourOrder> CalibrationTour::home(Timestamp now) {
  // The order needs some time until the drives have begun.
  if (report_->is_homed && report_->is_idle && in_step(now) > kToObey) {
    enter(Step::kMoving, now);
    return move(now);
  }
  if (in_step(now) > kForHoming)
    return refuse("homing does not end; check the homing switches and the sign of `gear`");
  return TourOrder{TourOrder::What::kHome, {}};
}

PanTilt CalibrationTour::place() const {
  if (step_ == Step::kMoving || step_ == Step::kGlancing) return places_.at(next_);
  return {configuration_.axes[0].neutral, configuration_.axes[1].neutral};
}

bool CalibrationTour::is_at(const PanTilt& place) const {
  return std::abs(report_->angles.pan - place.pan) < kNear &&
         std::abs(report_->angles.tilt - place.tilt) < kNear && std::abs(report_->rates.pan) < kAtRest &&
         std::abs(report_->rates.tilt) < kAtRest;
}

TourOrder CalibrationTour::towards(const PanTilt& place) const {
  const auto rate = [&](AxisName name, double from, double to) {
    const double most = std::min(kSpeed, configuration_.axis(name).limits.rate);
    return std::abs(to - from) < kNearEnough ? 0 : std::clamp(kPull * (to - from), -most, most);
  };
  return {TourOrder::What::kJog,
          {rate(AxisName::kPan, report_->angles.pan, place.pan),
           rate(AxisName::kTilt, report_->angles.tilt, place.tilt)}};
}

Result<TourOrder> CalibrationTour::move(Timestamp now) {
  if (!report_->is_idle) idle_.reset();
  if (report_->is_idle && !idle_) idle_ = now;
  if (idle_ && seconds_between(now, *idle_) > kOfIdleness)
    return refuse("the rig does not take its drives into work; see what its log says");
  const PanTilt to = place();
  if (!is_at(to)) at_place_.reset();
  if (is_at(to) && !at_place_) at_place_ = now;
  if (at_place_ && seconds_between(now, *at_place_) > kSettling) {
    if (step_ == Step::kToMiddle) {
      say(fmt::format("shaking gently, {:.0f} s", kShake));
      enter(Step::kShaking, now);
    } else {
      enter(Step::kGlancing, now);
    }
    return TourOrder{TourOrder::What::kJog, {}};
  }
  if (in_step(now) > kForPlace)
    return refuse(
        fmt::format("the axes do not get to {} but stand at pan {:.1f}, tilt {:.1f}; is anything in "
                    "the head's way?",
                    words_of(to), report_->angles.pan / kDegree, report_->angles.tilt / kDegree));
  return towards(to);
}

Result<TourOrder> CalibrationTour::glance(Timestamp now) {
  if (look_.poses.size() >= kImages || in_step(now) > kGlance) end_glance(now);
  return TourOrder{TourOrder::What::kJog, {}};
}

void CalibrationTour::end_glance(Timestamp now) {
  const std::string where =
      fmt::format("place {} of {} ({})", next_ + 1, places_.size(), words_of(places_.at(next_)));
  if (look_.poses.size() < kFewestImages || look_.reports == 0) {
    say(where + ": the tracker has no pose there; it is left out");
  } else {
    glances_.push_back(
        mean_of(look_.poses, {look_.angles.pan / look_.reports, look_.angles.tilt / look_.reports}));
    say(fmt::format("{}: {} images", where, look_.poses.size()));
  }
  next_place(now);
}

void CalibrationTour::next_place(Timestamp now) {
  ++next_;
  enter(next_ < places_.size() ? Step::kMoving : configuration_.imu ? Step::kToMiddle : Step::kLeaving, now);
}

Result<TourOrder> CalibrationTour::shake(Timestamp now) {
  const double t = in_step(now);
  if (t > kShake) {
    end_shake(now);
    return TourOrder{TourOrder::What::kJog, {}};
  }
  const auto rate = [&](AxisName name, double angle) {
    const AxisConfiguration& axis = configuration_.axis(name);
    const Swing swing = swing_of(axis, kShakeFrequencies.at(static_cast<size_t>(name)));
    return swing.rate_at(t) + kPull * (axis.neutral + swing.angle_at(t) - angle);
  };
  return TourOrder{TourOrder::What::kJog,
                   {rate(AxisName::kPan, report_->angles.pan), rate(AxisName::kTilt, report_->angles.tilt)}};
}

/// Ends a shake and looks whether the clocks' offset is sharp enough. What was seen in shakes before counts
/// too.
void CalibrationTour::end_shake(Timestamp now) {
  ++shakes_;
  gyro_found_ = align_camera_and_gyro(gyro_, rotations_);
  const bool is_sharp = *gyro_found_ && (*gyro_found_)->sigma <= kSharp;
  if (is_sharp || shakes_ >= kMostShakes) return enter(Step::kLeaving, now);
  say(*gyro_found_ ? fmt::format("the clocks' offset is known to {:.1f} ms; {:.0f} are asked for: once more",
                                 (*gyro_found_)->sigma * 1000, kSharp * 1000)
                   : (*gyro_found_).error().message + ": once more");
  enter(Step::kToMiddle, now);
}

Result<TourOrder> CalibrationTour::leave(Timestamp now) {
  if (report_->is_idle || in_step(now) > kForRig) enter(Step::kOver, now);
  return TourOrder{TourOrder::What::kIdle, {}};
}

Result<TourFindings> CalibrationTour::conclude() const {
  TourFindings found;
  auto hand_eye = calibrate_hand_eye(glances_);
  if (!hand_eye) return refuse("camera on the head: " + hand_eye.error().message);
  found.hand_eye = *hand_eye;
  found.glances = glances_.size();
  found.calibration = configuration_.calibration;
  found.calibration.head_from_camera = hand_eye->head_from_camera;
  if (!gyro_found_) return found;
  if (!*gyro_found_) return refuse("IMU and camera: " + gyro_found_->error().message);
  found.gyro = **gyro_found_;
  found.calibration.offset = std::chrono::nanoseconds(std::llround(found.gyro->offset * 1e9));
  if (found.gyro->rotation_known)
    found.calibration.head_from_imu = (hand_eye->head_from_camera * found.gyro->camera_from_imu).normalized();
  return found;
}

}  // namespace cairn
