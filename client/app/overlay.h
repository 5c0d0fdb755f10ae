// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "client/app/frame_observer.h"
#include "client/app/text_painter.h"
#include "client/tracking/tracker.h"
#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/image.h"
#include "common/map/ids.h"

namespace cairn {

/// All that an image of a frame shows: a value, so that it can be drawn later and elsewhere.
struct OverlayFrame {
  GrayImagePtr image;
  Timestamp time;
  size_t number = 0;
  FrameState state = FrameState::kStarting;
  std::optional<SE3> camera_from_map;  ///< where a pose was measured
  MapId map;
  std::string map_name;
  Revision revision;
  size_t map_keyframes = 0;
  size_t map_points = 0;
  int found = 0;
  int attempted = 0;
  double mean_depth = 0;  ///< [map unit] of the found points
  double cpu_ms = 0;
  MapSnapshotPtr snapshot;  ///< that the pose is in; may be null
  LabelListPtr labels;      ///< of that map; may be null
  std::vector<TrackedPoint> points;
  std::vector<TrailLine> trails;
  std::string note;         ///< of the tracker
  std::string server_text;  ///< of the session
  std::string rig;          ///< as FrameReport::rig
  CameraPtr camera;         ///< other values of the camera, of the same size; null: as at the start
};

[[nodiscard]] OverlayFrame make_overlay_frame(const FrameReport& report);

/// The choices of a person who looks at an overlay: what is drawn, and what is marked.
struct OverlayStyle {
  bool points = true;
  LabelId selected;  ///< a label to be marked; none: 0
};

/// Draws the camera's image with what the tracker knows: points found (coloured by pyramid level) and
/// missed (faint), trails before there is a map, the map's Z = 0 grid and axes where a pose was measured, the
/// map's labels, and two status lines below. Deterministic; used from one thread.
class Overlay {
 public:
  /// Small images are enlarged by a whole number, so that the status lines can be read. An image of an odd
  /// width gets one dark column more, one that stays narrower than 64 px what is missing.
  explicit Overlay(CameraPtr camera);

  /// Size of every image drawn [px].
  [[nodiscard]] cv::Size size() const;
  /// BGR; valid until the next call. `frame.image` must have the camera's size.
  [[nodiscard]] const cv::Mat& draw(const OverlayFrame& frame, const OverlayStyle& style = {});
  /// Canvas pixels per pixel of the camera.
  [[nodiscard]] int scale() const { return scale_; }

 private:
  void draw_background(const GrayView& image);
  void draw_trails(const std::vector<TrailLine>& trails);
  void draw_points(const std::vector<TrackedPoint>& points);
  void draw_grid(const SE3& camera_from_map);
  void draw_axes(const SE3& camera_from_map);
  void draw_labels(const OverlayFrame& frame, LabelId selected);
  void draw_status(const OverlayFrame& frame);
  void draw_text(const std::string& text, int row, const cv::Scalar& color);
  void draw_map_line(const SE3& camera_from_map, const Eigen::Vector3d& from, const Eigen::Vector3d& to,
                     const cv::Scalar& color, int thickness);
  void choose_grid(const OverlayFrame& frame);
  [[nodiscard]] cv::Point to_canvas(const Eigen::Vector2d& pixel) const;

  CameraPtr camera_;
  const int scale_;
  TextPainter painter_;
  cv::Mat canvas_;
  cv::Mat camera_area_;  ///< part of canvas_
  MapId grid_map_;
  double grid_step_ = 0;  ///< [map unit]; fixed for a map, so that the grid stands still in it
  std::optional<Timestamp> last_time_;
  double frame_rate_ = 0;  ///< [Hz] smoothed
};

}  // namespace cairn
