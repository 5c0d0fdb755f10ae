// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <string>

#include "client/app/frame_observer.h"
#include "client/rig/commander.h"
#include "common/geometry/camera.h"

namespace cairn {

struct RigPilotOptions {
  std::string label;       ///< to be fixated; empty: the point that is in the middle of the image
  bool makes_maps = true;  ///< else a camera without a map is lost
};

/// Tells the rig's commander what becomes of frames, and where in the map it is that is to be fixated. Used
/// from the thread of the frame loop.
class RigPilot final : public FrameObserver {
 public:
  /// Gives the commander to a task, at once.
  using With = std::function<void(const std::function<void(RigCommander&)>&)>;

  RigPilot(CameraPtr camera, RigPilotOptions options, With with)
      : camera_(std::move(camera)), options_(std::move(options)), with_(std::move(with)) {}

  void on_frame(const FrameReport& report) override;
  void on_relocalization_answer(const PlaceReport& report) override;

  /// The place that is fixated, in the map's frame.
  [[nodiscard]] const std::optional<Eigen::Vector3d>& fixated() const { return point_; }

 private:
  void choose(const FrameReport& report);
  void follow(const FrameReport& report);

  CameraPtr camera_;
  RigPilotOptions options_;
  With with_;
  std::optional<PointId> chosen_;         ///< of map_, unless a label is fixated
  std::optional<Eigen::Vector3d> point_;  ///< of map_, where its newest revision has it
  MapId map_;
  int wants_ = 0;  ///< point_ is of that one
};

}  // namespace cairn
