// SPDX-License-Identifier: Apache-2.0
#include "server/admin/exported_scene.h"

#include <algorithm>
#include <cstdio>
#include <string_view>

namespace cairn {
namespace {

constexpr std::string_view kImageStem = "keyframe-";

/// Fewest keyframes in which a point must be measured to be exported: other programs triangulate points,
/// which one keyframe does not allow.
constexpr size_t kFewestViews = 2;

/// The parts of a record of which a scene is made, by id.
struct Parts {
  explicit Parts(const MapRecord& record) {
    for (const KeyframeRecord& k : record.keyframes) {
      if (k.live) keyframes[k.id] = &k;
    }
    for (const MeasurementsRecord& m : record.measurements) measurements[m.keyframe] = &m;
    for (const ImageRecord& i : record.images) images[i.keyframe] = i.image;
    for (const SourcesRecord& block : record.sources) {
      for (const PointSource& source : block.points) sources[source.id] = &source;
    }
    for (const auto& [id, measured] : measurements) {
      if (!keyframes.contains(id)) continue;
      for (const Measurement& m : measured->measurements) ++views[m.point];
    }
  }
  std::map<KeyframeId, const KeyframeRecord*> keyframes;
  std::map<KeyframeId, const MeasurementsRecord*> measurements;
  std::map<KeyframeId, GrayImagePtr> images;
  std::map<PointId, const PointSource*> sources;
  std::map<PointId, size_t> views;  ///< that show it
};

std::string image_name(KeyframeId id) {
  char text[40];
  std::snprintf(text, sizeof(text), "%s%06llu.png", kImageStem.data(),
                static_cast<unsigned long long>(id.value));
  return text;
}

uint32_t camera_number(const CameraParameters& camera, std::map<uint32_t, CameraParameters>* cameras) {
  for (const auto& [number, known] : *cameras) {
    if (known == camera) return number;
  }
  const auto number = static_cast<uint32_t>(cameras->size() + 1);
  cameras->emplace(number, camera);
  return number;
}

ExportedPoint make_point(PointId id, const Eigen::Vector3d& position, const Parts& parts) {
  ExportedPoint point;
  point.id = id;
  point.position = position;
  const auto source = parts.sources.find(id);
  if (source == parts.sources.end()) return point;
  constexpr size_t kMiddle = kSourcePatchSize / 2;
  point.grey = source->second->pixels[kMiddle * kSourcePatchSize + kMiddle];
  const auto keyframe = parts.keyframes.find(source->second->keyframe);
  if (keyframe == parts.keyframes.end()) return point;
  point.normal =
      keyframe->second->camera_from_map.rotation().conjugate() * source->second->normal.cast<double>();
  return point;
}

}  // namespace

bool is_exported_image_name(const std::filesystem::path& file) {
  const std::string stem = file.stem();
  const std::string_view digits = std::string_view(stem).substr(std::min(kImageStem.size(), stem.size()));
  return file.extension() == ".png" && stem.starts_with(kImageStem) && digits.size() >= 6 &&
         digits.find_first_not_of("0123456789") == std::string_view::npos;
}

ExportedScene make_scene(const MapRecord& record) {
  const Parts parts(record);
  ExportedScene scene;
  std::map<PointId, ExportedPoint> points;
  for (const PositionsRecord& block : record.positions) {
    for (size_t slot = 0; slot < block.points.size(); ++slot) {
      const PointId id{uint64_t{block.block} * kBlockSlots + slot + 1};
      if (!block.points[slot].live) continue;
      const auto views = parts.views.find(id);
      if (views != parts.views.end() && views->second >= kFewestViews)
        points[id] = make_point(id, block.points[slot].position, parts);
    }
  }
  for (const auto& [id, keyframe] : parts.keyframes) {
    ExportedImage exported;
    exported.id = static_cast<uint32_t>(id.value);
    exported.camera = camera_number(keyframe->camera->parameters(), &scene.cameras);
    exported.file = image_name(id);
    exported.camera_from_map = keyframe->camera_from_map;
    const auto image = parts.images.find(id);
    if (image != parts.images.end()) exported.image = image->second;
    const auto measured = parts.measurements.find(id);
    if (measured == parts.measurements.end()) continue;
    for (const Measurement& m : measured->second->measurements) {
      const auto point = points.find(m.point);
      if (point == points.end()) continue;
      const auto place = static_cast<uint32_t>(exported.found.size());
      exported.found.emplace_back(m.point, m.pixel.cast<double>());
      const auto pixel = keyframe->camera->project(keyframe->camera_from_map * point->second.position);
      if (pixel) point->second.error += (*pixel - m.pixel.cast<double>()).norm();
      point->second.track.emplace_back(exported.id, place);
    }
    scene.images.push_back(std::move(exported));
  }
  for (auto& [id, point] : points) {
    if (point.track.size() < kFewestViews) continue;
    point.error /= static_cast<double>(point.track.size());
    scene.points.push_back(std::move(point));
  }
  return scene;
}

}  // namespace cairn
