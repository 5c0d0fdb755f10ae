// SPDX-License-Identifier: Apache-2.0
#include "client/capture/simulated_source.h"

#include "client/capture/simulated_rig_source.h"
#include "tests/world/simulator.h"

namespace cairn {
namespace {

/// Frames rendered as they are asked for; a run with the same options sees the same bytes.
class SimulatedSource final : public FrameSource {
 public:
  SimulatedSource(std::string scenario, Simulator simulator)
      : scenario_(std::move(scenario)), simulator_(std::make_shared<Simulator>(std::move(simulator))) {}

  Result<std::optional<Frame>> next() override {
    if (next_ == simulator_->frame_count()) return std::nullopt;
    const int index = next_++;
    auto frame = simulator_->frame(index);
    return Frame{static_cast<uint64_t>(index), frame.time,
                 std::make_shared<const GrayImage>(std::move(frame.image))};
  }
  std::optional<size_t> frame_count() const override {
    return static_cast<size_t>(simulator_->frame_count());
  }
  std::optional<CameraParameters> builtin_calibration() const override {
    return simulator_->camera().parameters();
  }
  ImuStreamPtr take_imu() override;
  std::string describe() const override {
    return "simulated " + scenario_ + ", " + std::to_string(simulator_->frame_count()) + " frames";
  }

 private:
  std::string scenario_;
  std::shared_ptr<Simulator> simulator_;
  int next_ = 0;
};

/// Samples measured as they are asked for.
class SimulatedImuStream final : public ImuStream {
 public:
  explicit SimulatedImuStream(std::shared_ptr<const Simulator> simulator)
      : simulator_(std::move(simulator)) {}

  std::optional<ImuMount> mount() const override {
    return ImuMount{simulator_->imu()->camera_from_imu().rotation(), {}};
  }
  void take(Timestamp time, std::vector<ImuSample>* samples) override {
    while (last_ < time) {
      const SimImuSample sample = simulator_->imu_sample(next_++);
      samples->push_back({sample.time, sample.rate, sample.acceleration});
      last_ = sample.time;
    }
  }

 private:
  std::shared_ptr<const Simulator> simulator_;
  int next_ = 0;
  Timestamp last_{-1};
};

ImuStreamPtr SimulatedSource::take_imu() {
  if (!simulator_->imu()) return nullptr;
  return std::make_unique<SimulatedImuStream>(simulator_);
}

}  // namespace

Result<std::unique_ptr<FrameSource>> open_simulated_source(const SourceUri& uri) {
  if (uri.options.contains("rig")) return open_simulated_rig_source(uri);
  SimulatorOptions options;
  for (const auto& [key, value] : uri.options) {
    if (auto status = options.set_option(key, value); !status) return tl::unexpected(status.error());
  }
  auto simulator = Simulator::make(uri.path, options);
  if (!simulator) return tl::unexpected(simulator.error());
  return std::make_unique<SimulatedSource>(uri.path, std::move(*simulator));
}

}  // namespace cairn
