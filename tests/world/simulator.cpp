// SPDX-License-Identifier: Apache-2.0
#include "tests/world/simulator.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <functional>
#include <initializer_list>
#include <numbers>

#include "tests/world/random.h"

namespace cairn {
namespace {

constexpr int kLoopFrames = 1800;
constexpr double kHandSeconds = 1.2;
constexpr double kBlackoutSeconds = 0.5;
constexpr double kJerkSeconds = 0.6;
constexpr double kShoulderSteadiness = 1.6;

enum Stream : uint64_t { kHands = 0x68, kBlackouts = 0x62, kJerks = 0x6A };

Status bad_value(std::string_view key, std::string_view text) {
  std::string message = "simulator option ";
  message.append(key).append("='").append(text).append("': must be");
  for (const auto& help : SimulatorOptions::help()) {
    if (help.key == key) message.append(" ").append(help.text);
  }
  return fail(ErrorCode::kUsage, message);
}

template <typename Number>
Status parse(std::string_view key, std::string_view text, Number low, Number high, Number* value) {
  Number parsed{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), parsed);
  // Negated, so that a NaN fails.
  if (error != std::errc{} || end != text.data() + text.size() || !(parsed >= low && parsed <= high)) {
    return bad_value(key, text);
  }
  *value = parsed;
  return {};
}

template <typename Value>
struct Word {
  std::string_view text;
  Value value;
};
template <typename Value>
Status choose(std::string_view key, std::string_view text, std::initializer_list<Word<Value>> words,
              Value* value) {
  for (const Word<Value>& word : words) {
    if (word.text != text) continue;
    *value = word.value;
    return {};
  }
  return bad_value(key, text);
}

void lay_over(const Overlay& overlay, GrayImage* image) {
  for (int y = 0; y < image->height(); ++y) {
    uint8_t* row = image->row(y);
    for (int x = 0; x < image->width(); ++x) {
      const float world = row[x];
      const float seen = world + overlay.opacity.at(x, y) * (255 * overlay.grey.at(x, y) - world);
      row[x] = static_cast<uint8_t>(std::lround(seen));
    }
  }
}

}  // namespace

const std::vector<SimulatorOptions::Help>& SimulatorOptions::help() {
  static const std::vector<Help> options = {
      {"seed", "a whole number from 0: decides world, route, hand and noise"},
      {"camera", "hand or shoulder: which of the wearer's cameras"},
      {"light", "morning or later: geometry and motion stay"},
      {"session", "all, map or visit: both parts of an experiment or one"},
      {"walks",
       "yes, dark (the camera is covered on the way between places) or slow (sidling, the view held)"},
      {"frames", "a number of frames, 1 to 1000000; all of the route if not given"},
      {"noise", "sigma of the pixel noise in grey levels, 0 to 50"},
      {"blur", "shutter as a fraction of the frame time, 0 to 1"},
      {"rolling", "read-out as a fraction of the frame time, 0 to 1"},
      {"speed", "a factor on the speed of the hand, 0.05 to 10"},
      {"exposure", "amplitude of the changes of exposure, 0 to 0.9"},
      {"hands", "times a minute that a hand comes before the lens, 0 to 20"},
      {"blackouts", "times a minute that the image is black, 0 to 20"},
      {"jerks", "times a minute that the camera is jerked aside and back, 0 to 20"},
      {"imu", "samples a second of an IMU on the camera, 20 to 2000"},
  };
  return options;
}

Status SimulatorOptions::set_option(std::string_view key, std::string_view value) {
  if (key == "seed") return parse<uint64_t>(key, value, 0, UINT64_MAX, &seed);
  if (key == "frames") return parse(key, value, 1, 1000000, &frames);
  if (key == "noise") return parse(key, value, 0.0, 50.0, &noise);
  if (key == "blur") return parse(key, value, 0.0, 1.0, &blur);
  if (key == "rolling") return parse(key, value, 0.0, 1.0, &rolling);
  if (key == "speed") return parse(key, value, 0.05, 10.0, &speed);
  if (key == "exposure") return parse(key, value, 0.0, 0.9, &exposure);
  if (key == "hands") return parse(key, value, 0.0, 20.0, &hands);
  if (key == "blackouts") return parse(key, value, 0.0, 20.0, &blackouts);
  if (key == "jerks") return parse(key, value, 0.0, 20.0, &jerks);
  if (key == "imu") return parse(key, value, 20.0, 2000.0, &imu);
  if (key == "camera") {
    return choose(key, value, {{"hand", Carrier::kHand}, {"shoulder", Carrier::kShoulder}}, &carrier);
  }
  if (key == "light") {
    return choose(key, value, {{"morning", Daytime::kMorning}, {"later", Daytime::kLater}}, &daytime);
  }
  if (key == "session") {
    return choose(key, value, {{"all", Session::kAll}, {"map", Session::kMap}, {"visit", Session::kVisit}},
                  &session);
  }
  if (key == "walks") {
    return choose(key, value, {{"yes", Walks::kBrisk}, {"dark", Walks::kDark}, {"slow", Walks::kSlow}},
                  &walks);
  }
  std::string message = "simulator option '";
  message.append(key).append("': unknown; there are:");
  for (const Help& option : help()) message.append(" ").append(option.key);
  return fail(ErrorCode::kUsage, message);
}

Simulator::Simulator(Scenario scenario, const SimulatorOptions& options)
    : options_(options),
      hand_body_(options.hands > 0 ? add_hand(options.seed, &scenario) : 0),
      scenario_(std::make_unique<const Scenario>(std::move(scenario))),
      clock_{options.speed, scenario_->calm},
      motion_(scenario_->route, kWaypointInterval, clock_, options.seed,
              scenario_->carrier == Carrier::kShoulder ? kShoulderSteadiness : 1),
      hands_(options.hands, kHandSeconds, options.seed, kHands),
      blackouts_(options.blackouts, kBlackoutSeconds, options.seed, kBlackouts),
      jerks_(options.jerks, kJerkSeconds, options.seed, kJerks),
      imu_(options.imu > 0 ? std::optional(SimImu(options.imu, options.seed)) : std::nullopt),
      renderer_(*scenario_),
      census_(*scenario_) {
  frame_count_ =
      options.frames > 0 ? options.frames
      : scenario_->endless
          ? kLoopFrames
          : static_cast<int>(clock_.seconds_at(scenario_->phases.back().end) * kSimulatorFrameRate);
}

Result<Simulator> Simulator::make(std::string_view scenario, const SimulatorOptions& options) {
  auto made = make_scenario(scenario,
                            {options.seed, options.carrier, options.daytime, options.session, options.walks});
  if (!made) return tl::unexpected(made.error());
  return Simulator(std::move(*made), options);
}

SE3 Simulator::map_from_camera(double seconds) const {
  const SE3 pose = turned(motion_.map_from_camera(seconds), scenario_->turns, clock_.at(seconds));
  const auto jerked = jerks_.at(seconds);
  return jerked ? pose * jerk(jerked->part, jerked->event, options_.seed) : pose;
}

SimImuSample Simulator::imu_sample(int index) const {
  return imu_->sample(index, [this](double seconds) { return map_from_camera(seconds); });
}

SE3 Simulator::map_from_body(size_t body, double seconds) const {
  if (body == 0 || body != hand_body_) return scenario_->bodies[body].at(clock_.at(seconds));
  const auto passing = hands_.at(seconds);
  return map_from_camera(seconds) * camera_from_hand(passing ? passing->part : 0);
}

SE3 Simulator::map_from_place(int place, double seconds) const {
  const Place& wanted = scenario_->places[static_cast<size_t>(place)];
  return map_from_body(static_cast<size_t>(wanted.body), seconds) * wanted.body_from_place;
}

std::vector<ViewMatrix> Simulator::camera_from_bodies(double seconds) const {
  const SE3 camera_from_map = map_from_camera(seconds).inverse();
  std::vector<ViewMatrix> camera_from_body;
  for (size_t body = 0; body < scenario_->bodies.size(); ++body) {
    camera_from_body.emplace_back(camera_from_map * map_from_body(body, seconds));
  }
  return camera_from_body;
}

std::vector<Phase> Simulator::phases() const {
  std::vector<Phase> phases = scenario_->phases;
  for (Phase& phase : phases) {
    phase.begin = clock_.seconds_at(phase.begin);
    phase.end = clock_.seconds_at(phase.end);
  }
  return phases;
}

bool Simulator::is_dark(double seconds) const {
  if (blackouts_.at(seconds)) return true;
  return options_.walks == Walks::kDark && std::ranges::any_of(scenario_->phases, [&](const Phase& phase) {
           const double on_route = clock_.at(seconds);
           return phase.kind == PhaseKind::kWalk && on_route >= phase.begin && on_route < phase.end;
         });
}

SimView Simulator::view(int index) const {
  const double seconds = time(index).seconds();
  SimView view;
  view.dark = is_dark(seconds);
  if (view.dark) return view;
  const auto [shares, depth] = census_.survey(camera_from_bodies(seconds));
  view.depth = depth;
  for (int i = 0; i < static_cast<int>(shares.size()); ++i) {
    const double share = shares[static_cast<size_t>(i)];
    if (share > 0) view.places.push_back({i, share, map_from_place(i, seconds)});
  }
  std::ranges::stable_sort(view.places, std::greater{}, &SimView::PlaceShare::share);
  return view;
}

std::optional<SimThing> Simulator::thing_at(int index, const Eigen::Vector2d& pixel) const {
  const double seconds = time(index).seconds();
  if (is_dark(seconds)) return std::nullopt;
  const Eigen::Vector3d bearing = camera().unproject(pixel);
  const Eigen::Vector3d ray = bearing / bearing.z();
  const auto sight = census_.look(camera_from_bodies(seconds), ray.head<2>());
  if (!sight || sight->place < 0) return std::nullopt;
  const Eigen::Vector3d in_map = map_from_camera(seconds) * Eigen::Vector3d(sight->depth * ray);
  return SimThing{sight->place, sight->depth, map_from_place(sight->place, seconds).inverse() * in_map};
}

Timestamp Simulator::time(int index) const {
  return Timestamp::from_seconds(index / kSimulatorFrameRate);
}

/// Slow automatic exposure that hunts: two periods without a common measure.
double Simulator::gain_at(double seconds) const {
  const double phase = 2 * std::numbers::pi * Random(options_.seed, 0x6761696E).unit();
  const double wave = 0.65 * std::sin(2 * std::numbers::pi * seconds / 7.3 + phase) +
                      0.35 * std::sin(2 * std::numbers::pi * seconds / 2.9 + 2 * phase);
  return 1 + options_.exposure * wave;
}

SimFrame Simulator::frame(int index) {
  SimFrame frame;
  frame.time = time(index);
  const double seconds = frame.time.seconds();
  frame.map_from_camera = map_from_camera(seconds);
  Exposure exposure;
  exposure.shutter = options_.blur / kSimulatorFrameRate;
  exposure.readout = options_.rolling / kSimulatorFrameRate;
  exposure.gain = is_dark(seconds) ? 0 : gain_at(seconds);
  exposure.noise_sigma = options_.noise;
  exposure.noise_key = mix_bits(options_.seed) + static_cast<uint64_t>(index);
  renderer_.render([&](double offset) { return map_from_camera(seconds + offset).inverse(); }, exposure,
                   &frame.image,
                   [&](size_t body, double offset) { return map_from_body(body, seconds + offset); });
  if (scenario_->overlay) lay_over(*scenario_->overlay, &frame.image);
  return frame;
}

}  // namespace cairn
