// SPDX-License-Identifier: Apache-2.0
#include "tests/world/simulator.h"

#include <charconv>
#include <cmath>
#include <numbers>

#include "tests/world/random.h"

namespace cairn {
namespace {

constexpr double kWaypointInterval = 0.6;  // s

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

}  // namespace

const std::vector<SimulatorOptions::Help>& SimulatorOptions::help() {
  static const std::vector<Help> options = {
      {"seed", "a whole number from 0: decides world, route, hand and noise"},
      {"camera", "hand (the only one so far)"},
      {"frames", "a number of frames, 1 to 1000000"},
      {"noise", "sigma of the pixel noise in grey levels, 0 to 50"},
      {"blur", "shutter as a fraction of the frame time, 0 to 1"},
      {"rolling", "read-out as a fraction of the frame time, 0 to 1"},
      {"speed", "a factor on the speed of the hand, 0.05 to 10"},
      {"exposure", "amplitude of the changes of exposure, 0 to 0.9"},
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
  if (key == "camera") {
    if (value == "hand") return {};
    return bad_value(key, value);
  }
  std::string message = "simulator option '";
  message.append(key).append("': unknown; there are:");
  for (const Help& option : help()) message.append(" ").append(option.key);
  return fail(ErrorCode::kUsage, message);
}

Simulator::Simulator(Scenario scenario, const SimulatorOptions& options)
    : scenario_(std::make_unique<const Scenario>(std::move(scenario))),
      options_(options),
      motion_(scenario_->route, kWaypointInterval, options.speed, options.seed),
      renderer_(*scenario_) {}

Result<Simulator> Simulator::make(std::string_view scenario, const SimulatorOptions& options) {
  auto made = make_scenario(scenario, options.seed);
  if (!made) return tl::unexpected(made.error());
  return Simulator(std::move(*made), options);
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
  exposure.gain = gain_at(seconds);
  exposure.noise_sigma = options_.noise;
  exposure.noise_key = mix_bits(options_.seed) + static_cast<uint64_t>(index);
  renderer_.render([&](double offset) { return map_from_camera(seconds + offset).inverse(); }, exposure,
                   &frame.image);
  return frame;
}

}  // namespace cairn
