// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "common/geometry/camera.h"
#include "server/mapping/map_record.h"

/// A map as programs outside see one: cameras, posed images, points with tracks. Pure.
namespace cairn {

struct ExportedImage {
  uint32_t id = 0;  ///< the keyframe's
  uint32_t camera = 0;
  std::string file;  ///< name of the image's file
  SE3 camera_from_map;
  std::vector<std::pair<PointId, Eigen::Vector2d>> found;  ///< (0,0) is the centre of the first pixel
  GrayImagePtr image;
};

struct ExportedPoint {
  PointId id;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< map frame
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();    ///< unit, map frame
  uint8_t grey = 0;                                    ///< of the middle of its patch
  double error = 0;  ///< [px] mean distance of its measurements from its projections
  std::vector<std::pair<uint32_t, uint32_t>> track;  ///< image and place in its `found`
};

struct ExportedScene {
  std::map<uint32_t, CameraParameters> cameras;
  std::vector<ExportedImage> images;  ///< ascending by id
  std::vector<ExportedPoint> points;  ///< ascending by id; of two views or more, as others want them
  bool rgb = false;                   ///< images are written with three equal channels; the map's are grey
};

/// Whether it is the name of some ExportedImage's file.
[[nodiscard]] bool is_exported_image_name(const std::filesystem::path& file);

/// The live keyframes and points of a whole record.
[[nodiscard]] ExportedScene make_scene(const MapRecord& record);

}  // namespace cairn
