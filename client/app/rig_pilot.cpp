// SPDX-License-Identifier: Apache-2.0
#include "client/app/rig_pilot.h"

#include <algorithm>
#include <limits>
#include <utility>

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
      (tracked && report.result.map != map_)) {
    point_.reset();
    chosen_.reset();
  }
  if (aim == RigAim::kFixate && tracked) {
    map_ = report.result.map;
    if (!chosen_) choose(report);
    follow(report);
  }
  RigSight sight;
  sight.time = report.frame.time;
  sight.tracked = tracked;
  sight.poor = report.state == FrameState::kPoor;
  sight.lost = report.state == FrameState::kLost;
  sight.verifying = report.result.verifying;
  sight.map = report.result.map;
  sight.lost = sight.lost || (report.state == FrameState::kStarting && !options_.makes_maps);
  if (tracked && point_) sight.target = report.result.camera_from_map * *point_;
  with_([&sight](RigCommander& commander) { commander.see(sight); });
}

/// The point that was found nearest to the middle of the image.
void RigPilot::choose(const FrameReport& report) {
  if (!options_.label.empty() || !report.snapshot || report.snapshot->map != report.result.map) return;
  const Eigen::Vector2d middle(0.5 * (camera_->width() - 1), 0.5 * (camera_->height() - 1));
  double nearest = std::numeric_limits<double>::infinity();
  for (const TrackedPoint& point : report.result.points) {
    const double off = (point.pixel.cast<double>() - middle).squaredNorm();
    if (!point.found || off >= nearest || !report.snapshot->find(point.id)) continue;
    nearest = off;
    chosen_ = point.id;
  }
}

/// Adjustments of the map move both points and labels. What has gone from the map is still where it was.
void RigPilot::follow(const FrameReport& report) {
  if (!options_.label.empty()) {
    if (!report.labels) return;
    const auto found = std::find_if(report.labels->begin(), report.labels->end(),
                                    [this](const Label& label) { return label.text == options_.label; });
    if (found != report.labels->end()) point_ = found->map_from_label.translation();
  } else if (chosen_ && report.snapshot && report.snapshot->map == report.result.map) {
    if (const auto slot = report.snapshot->find(*chosen_))
      point_ = report.snapshot->point_blocks[static_cast<size_t>(slot->block)]->position(slot->slot);
  }
}

void RigPilot::on_relocalization_answer(const PlaceReport& report) {
  if (!report.tried) return;
  with_([&report](RigCommander& commander) { commander.try_place(report.asked); });
}

}  // namespace cairn
