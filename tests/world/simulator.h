// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"
#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/image.h"
#include "tests/world/census.h"
#include "tests/world/disturbance.h"
#include "tests/world/motion.h"
#include "tests/world/render.h"
#include "tests/world/scenario.h"
#include "tests/world/sim_imu.h"

namespace cairn {

constexpr double kSimulatorFrameRate = 30;  // Hz

/// Settings that the URI of a `sim:` source and the options of cairn-sim can change.
struct SimulatorOptions {
  uint64_t seed = 1;  ///< of the world, the route, the hand and the noise
  Carrier carrier = Carrier::kHand;
  Daytime daytime = Daytime::kMorning;
  Session session = Session::kAll;
  int frames = 0;  ///< number of frames; 0: the whole route, or 1800 where it is a closed loop
  Walks walks = Walks::kBrisk;
  double noise = 1.5;      ///< Gaussian noise, grey levels (sigma)
  double blur = 0.25;      ///< shutter: fraction of the frame time that each row is exposed
  double rolling = 0;      ///< read-out: fraction of the frame time from the first row to the last
  double speed = 1;        ///< factor on the speed of the hand
  double exposure = 0.08;  ///< amplitude of the changes of gain, as a fraction
  double hands = 0;        ///< times a minute that a hand comes before the lens, for 1.2 s
  double blackouts = 0;    ///< times a minute that the image is black, for 0.5 s
  double jerks = 0;        ///< times a minute that the camera is jerked aside and back, within 0.6 s
  double imu = 0;          ///< samples a second of an IMU on the camera; 0: it has none

  /// Sets an option from its name and text, as in `sim:desk?seed=2&noise=3`. kUsage names the option and what
  /// it takes.
  [[nodiscard]] Status set_option(std::string_view key, std::string_view value);
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

/// A description of what there is to see in a frame.
struct SimView {
  struct PlaceShare {
    int place = 0;       ///< index into the places
    double share = 0;    ///< of the image, > 0
    SE3 map_from_place;  ///< at the frame's time
  };
  std::vector<PlaceShare> places;  ///< the largest share first; empty in the dark
  double depth = 0;                ///< [m], the median along the camera's axis; 0 in the dark
  bool dark = false;               ///< blackout, or covered
};

/// A thing of a place, as a pixel of a frame shows it.
struct SimThing {
  int place = 0;             ///< index into the places
  double depth = 0;          ///< [m] along the camera's axis
  Eigen::Vector3d in_place;  ///< the point, in the place's frame
};

/// A camera in a simulated world. Frames may be asked for in any order: frame i is the same whenever it is
/// rendered. One per thread.
class Simulator {
 public:
  Simulator(Scenario scenario, const SimulatorOptions& options);
  /// The named scenario with the seed of the options.
  [[nodiscard]] static Result<Simulator> make(std::string_view scenario, const SimulatorOptions& options);

  [[nodiscard]] int frame_count() const { return frame_count_; }
  [[nodiscard]] const Camera& camera() const { return *scenario_->camera; }
  [[nodiscard]] CameraPtr shared_camera() const { return scenario_->camera; }

  [[nodiscard]] Timestamp time(int index) const;
  /// Truth at any time [s] from the start.
  [[nodiscard]] SE3 map_from_camera(double seconds) const;
  /// Renders frame `index`, 0 <= index < frame_count().
  [[nodiscard]] SimFrame frame(int index);

  /// The IMU on the camera; nothing without one.
  [[nodiscard]] const std::optional<SimImu>& imu() const { return imu_; }
  [[nodiscard]] SimImuSample imu_sample(int index) const;

  [[nodiscard]] const std::vector<Place>& places() const { return scenario_->places; }
  /// The phases in order, without gaps; times in seconds from the start.
  [[nodiscard]] std::vector<Phase> phases() const;
  /// Describes what frame `index` shows, without rendering it.
  [[nodiscard]] SimView view(int index) const;
  /// The thing at a pixel of frame `index`, at the frame's time; nothing in the dark and where nothing of a
  /// place shows.
  [[nodiscard]] std::optional<SimThing> thing_at(int index, const Eigen::Vector2d& pixel) const;

 private:
  [[nodiscard]] bool is_dark(double seconds) const;
  [[nodiscard]] double gain_at(double seconds) const;
  [[nodiscard]] SE3 map_from_body(size_t body, double seconds) const;
  [[nodiscard]] SE3 map_from_place(int place, double seconds) const;
  [[nodiscard]] std::vector<ViewMatrix> camera_from_bodies(double seconds) const;

  SimulatorOptions options_;
  size_t hand_body_;                          ///< 0 without
  std::unique_ptr<const Scenario> scenario_;  // where the renderer looks, also after a move
  RouteClock clock_;
  HandMotion motion_;
  EventTrain hands_;
  EventTrain blackouts_;
  EventTrain jerks_;
  std::optional<SimImu> imu_;
  int frame_count_;
  Renderer renderer_;
  Census census_;
};

}  // namespace cairn
