// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"
#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/image.h"
#include "tests/world/motion.h"
#include "tests/world/render.h"
#include "tests/world/scenario.h"

namespace cairn {

constexpr double kSimulatorFrameRate = 30;  // Hz

/// What the URI of a `sim:` source and the options of cairn-sim can set.
struct SimulatorOptions {
  uint64_t seed = 1;       ///< of the world, the route, the hand and the noise
  int frames = 1800;       ///< number of frames; the route is a closed loop and goes on for ever
  double noise = 1.5;      ///< Gaussian noise, grey levels (sigma)
  double blur = 0.25;      ///< shutter: fraction of the frame time that each row is exposed
  double rolling = 0;      ///< read-out: fraction of the frame time from the first row to the last
  double speed = 1;        ///< factor on the speed of the hand
  double exposure = 0.08;  ///< amplitude of the changes of gain, as a fraction

  /// Sets an option from its name and text, as in `sim:desk?seed=2&noise=3`. kUsage names the option and what
  /// it takes.
  Status set_option(std::string_view key, std::string_view value);
  struct Help {
    std::string_view key;
    std::string_view text;
  };
  [[nodiscard]] static const std::vector<Help>& help();
};

struct SimFrame {
  Timestamp time;  ///< middle of the exposure of the middle row; the first frame is at 0
  GrayImage image;
  SE3 map_from_camera;  ///< exact, at `time`
};

/// A camera in a simulated world. Frames may be asked for in any order: frame i is the same whenever it is
/// rendered. One per thread.
class Simulator {
 public:
  Simulator(Scenario scenario, const SimulatorOptions& options);
  /// The named scenario with the seed of the options.
  [[nodiscard]] static Result<Simulator> make(std::string_view scenario, const SimulatorOptions& options);

  [[nodiscard]] int frame_count() const { return options_.frames; }
  [[nodiscard]] const Camera& camera() const { return *scenario_->camera; }
  [[nodiscard]] CameraPtr shared_camera() const { return scenario_->camera; }

  [[nodiscard]] Timestamp time(int index) const;
  /// Truth at any time [s] from the start.
  [[nodiscard]] SE3 map_from_camera(double seconds) const { return motion_.map_from_camera(seconds); }
  /// Renders frame `index`, 0 <= index < frame_count().
  [[nodiscard]] SimFrame frame(int index);

 private:
  [[nodiscard]] double gain_at(double seconds) const;

  std::unique_ptr<const Scenario> scenario_;  // where the renderer looks, also after a move
  SimulatorOptions options_;
  HandMotion motion_;
  Renderer renderer_;
};

}  // namespace cairn
