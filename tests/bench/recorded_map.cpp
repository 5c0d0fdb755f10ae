// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/recorded_map.h"

#include <cstdio>
#include <limits>

#include "common/io/calibration.h"

namespace cairn {
namespace {

/// Keeps the poses that the tracker gives.
class LivePoses final : public MappingObserver {
 public:
  void on_frame(const Frame& frame, const FrameResult& result, double /*ms*/) override {
    if (result.pose_measured) poses.push_back({frame.time, result.camera_from_map.inverse()});
  }
  std::vector<StampedPose> poses;
};

}  // namespace

Result<std::unique_ptr<FrameSource>> open_aloud(const std::string& uri) {
  auto source = open_source(uri);
  if (!source) return source;
  for (const SourceNote& note : (*source)->notes()) std::fprintf(stderr, "%s\n", note.text.c_str());
  return source;
}

Result<CameraPtr> choose_camera(const FrameSource& source, const std::string& uri, const std::string& file) {
  if (file.empty()) {
    if (const auto known = source.builtin_calibration()) return make_camera(*known);
  }
  const auto path = file.empty() ? find_calibration(uri) : file;
  if (!path)
    return fail(ErrorCode::kConfiguration, uri + ": no camera.txt beside it; pass --calibration FILE");
  const auto calibration = read_calibration(*path, source.image_size());
  if (!calibration) return tl::unexpected(calibration.error());
  if (Status fits = check_image_size(source, *calibration); !fits) return tl::unexpected(fits.error());
  return make_camera(*calibration);
}

Result<RecordedMap> map_beginning(FrameSource* source, size_t frames, const CameraPtr& camera, MapId map,
                                  uint64_t seed) {
  LivePoses live;
  MappingOptions options;
  options.map = map;
  options.seed = seed;
  options.observer = &live;
  MappingLoop mapping(camera, options);
  for (size_t i = 0; i < frames; ++i) {
    auto next = source->next();
    if (next && !*next) break;
    if (next) mapping.frame(**next);
  }
  if (mapping.maker() == nullptr) return fail(ErrorCode::kDegenerate, "no map came of the first frames");
  return RecordedMap{mapping.indexed(), std::move(live.poses), mapping.record()};
}

Status map_others(const std::vector<std::string>& sources, uint8_t first, uint64_t seed, PlaceIndex* index) {
  MapId id;
  id.bytes[0] = first;
  for (const std::string& uri : sources) {
    auto source = open_aloud(uri);
    if (!source) return tl::unexpected(source.error());
    const auto camera = choose_camera(**source, uri, "");
    if (!camera) return tl::unexpected(camera.error());
    const auto recorded = map_beginning(source->get(), std::numeric_limits<size_t>::max(), *camera, id, seed);
    if (!recorded) return fail(recorded.error().code, uri + ": " + recorded.error().message);
    index->put(recorded->map);
    ++id.bytes[0];
  }
  return {};
}

}  // namespace cairn
