// SPDX-License-Identifier: Apache-2.0
#include "client/capture/simulated_rig_source.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <string>
#include <string_view>
#include <utility>

#include "tests/world/camera_feed.h"
#include "tests/world/random.h"
#include "tests/world/simulator.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr milliseconds kPatience{2000};
constexpr nanoseconds kPeriod{static_cast<int64_t>(1e9 / kSimulatorFrameRate)};

/// The simulator's options that this source takes: the world, and how an image is taken.
constexpr std::array<std::string_view, 8> kOptions = {"seed",  "camera", "light", "session",
                                                      "walks", "noise",  "blur",  "rolling"};

class SimulatedRigSource final : public FrameSource {
 public:
  SimulatedRigSource(std::string path, Scenario scenario, const SimulatorOptions& options, CameraTruth truth)
      : path_(std::move(path)),
        scenario_(std::make_unique<const Scenario>(std::move(scenario))),
        options_(options),
        truth_(std::move(truth)),
        renderer_(*scenario_) {}

  /// An image is there once its exposure is over; of several that are, the newest is rendered.
  Result<std::optional<Frame>> next() override {
    const auto begun = std::chrono::steady_clock::now();
    for (milliseconds most(0);; most = milliseconds(100)) {
      const auto news = truth_.wait(most);
      if (!begin_) begin_ = truth_.oldest();
      const auto last = begin_ ? last_exposed() : -1;
      if (last >= next_) {
        next_ = last + 1;
        return render(last);
      }
      if (news == CameraTruth::News::kEnd) return std::nullopt;
      if (std::chrono::steady_clock::now() - begun > kPatience) {
        return fail(ErrorCode::kIo,
                    describe() + ": nothing has come for " + std::to_string(kPatience.count() / 1000) + " s");
      }
    }
  }
  std::optional<size_t> frame_count() const override { return std::nullopt; }
  std::optional<CameraParameters> builtin_calibration() const override {
    return scenario_->camera->parameters();
  }
  std::string describe() const override { return "camera of the simulated rig at " + path_; }
  bool is_live() const override { return true; }

 private:
  [[nodiscard]] nanoseconds after_middle() const {
    return std::chrono::duration_cast<nanoseconds>(kPeriod * (options_.blur + options_.rolling) / 2);
  }
  /// Index of the latest frame that has been exposed.
  [[nodiscard]] int64_t last_exposed() const {
    return (*truth_.newest() - *begin_ - after_middle()).count() / kPeriod.count();
  }
  [[nodiscard]] Frame render(int64_t index) {
    const Timestamp time = *begin_ + index * kPeriod;
    Exposure exposure;
    exposure.shutter = options_.blur / kSimulatorFrameRate;
    exposure.readout = options_.rolling / kSimulatorFrameRate;
    exposure.noise_sigma = options_.noise;
    exposure.noise_key = mix_bits(options_.seed) + static_cast<uint64_t>(index);
    GrayImage image;
    renderer_.render(
        [&](double offset) {
          return truth_.map_from_camera(time + nanoseconds(static_cast<int64_t>(1e9 * offset))).inverse();
        },
        exposure, &image);
    return {static_cast<uint64_t>(index), time, std::make_shared<const GrayImage>(std::move(image))};
  }

  std::string path_;
  std::unique_ptr<const Scenario> scenario_;  // where the renderer looks
  SimulatorOptions options_;
  CameraTruth truth_;
  Renderer renderer_;
  std::optional<Timestamp> begin_;  ///< of frame 0
  int64_t next_ = 1;                ///< the exposure of frame 0 began before anything was known
};

}  // namespace

Result<std::unique_ptr<FrameSource>> open_simulated_rig_source(const SourceUri& uri) {
  SimulatorOptions options;
  options.carrier = Carrier::kShoulder;
  std::string path;
  for (const auto& [key, value] : uri.options) {
    if (key == "rig") {
      path = value;
    } else if (std::find(kOptions.begin(), kOptions.end(), key) == kOptions.end()) {
      return fail(ErrorCode::kUsage, fmt::format("sim: with rig= there is no option '{}': the rig moves the "
                                                 "camera; there are: {}",
                                                 key, fmt::join(kOptions, " ")));
    } else if (auto status = options.set_option(key, value); !status) {
      return tl::unexpected(status.error());
    }
  }
  auto scenario = make_scenario(
      uri.path, {options.seed, options.carrier, options.daytime, options.session, options.walks});
  if (!scenario) return tl::unexpected(scenario.error());
  auto truth = CameraTruth::join(path);
  if (!truth) return tl::unexpected(truth.error());
  return std::make_unique<SimulatedRigSource>(path, *std::move(scenario), options, *std::move(truth));
}

}  // namespace cairn
