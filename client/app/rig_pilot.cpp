// SPDX-License-Identifier: Apache-2.0
#include "client/app/rig_pilot.h"

#include <algorithm>
#include <utility>

#include "client/app/label_view.h"

namespace cairn {

void RigPilot::on_frame(const FrameReport& report) {
  const bool tracked = is_tracked(report.state);
  RigAim aim{};
  int wants = 0;
  with_([&](RigCommander& commander) {
    aim = commander.aim();
    wants = commander.wants();
  });
  if (std::exchange(wants_, wants) != wants || aim != RigAim::kFixate ||
      (tracked && report.result.map != map_))
    point_.reset();
  if (aim == RigAim::kFixate && tracked && !point_) {
    point_ = choose(report);
    map_ = report.result.map;
  }
  RigSight sight{report.frame.time, tracked, report.state == FrameState::kLost, report.result.on_trial, {}};
  sight.lost = sight.lost || (report.state == FrameState::kStarting && !options_.makes_maps);
  if (tracked && point_) sight.target = report.result.camera_from_map * *point_;
  with_([&sight](RigCommander& commander) { commander.see(sight); });
}

/// In the map: the label's place, or the point that was found nearest to the middle of the picture.
std::optional<Eigen::Vector3d> RigPilot::choose(const FrameReport& report) const {
  if (!options_.label.empty()) {
    if (!report.labels) return std::nullopt;
    const auto found = std::find_if(report.labels->begin(), report.labels->end(),
                                    [this](const Label& label) { return label.text == options_.label; });
    if (found == report.labels->end()) return std::nullopt;
    return found->map_from_label.translation();
  }
  if (!report.snapshot || report.snapshot->map != report.result.map) return std::nullopt;
  const SE3& camera_from_map = report.result.camera_from_map;
  const auto seen = seen_points(report.result.points, *report.snapshot, camera_from_map);
  const Eigen::Vector2d middle(0.5 * (camera_->width() - 1), 0.5 * (camera_->height() - 1));
  const auto off = [&](const SeenPoint& point) { return (point.pixel - middle).squaredNorm(); };
  const auto nearest = std::min_element(
      seen.begin(), seen.end(), [&](const SeenPoint& a, const SeenPoint& b) { return off(a) < off(b); });
  if (nearest == seen.end()) return std::nullopt;
  return camera_from_map.inverse() * nearest->position;
}

void RigPilot::on_place_answer(const PlaceReport& report) {
  if (!report.tried) return;
  with_([&report](RigCommander& commander) { commander.try_place(report.asked); });
}

}  // namespace cairn
