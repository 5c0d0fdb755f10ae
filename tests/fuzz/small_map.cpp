// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/small_map.h"

namespace cairn::fuzz {
namespace {

constexpr int kWidth = 32;
constexpr int kHeight = 24;
constexpr size_t kPoints = 3;

SE3 pose(double x) {
  return {Eigen::Quaterniond(0.9, 0.1, 0.2, 0.3).normalized(), {x, 2, 3}};
}

PointSource source(size_t index) {
  PointSource point;
  point.id = PointId{index + 1};
  point.keyframe = KeyframeId{1};
  point.corner = {static_cast<int16_t>(8 + index), 12};
  point.ray_center = {0, 0, 1};
  point.ray_right = Eigen::Vector3f(0.03F, 0, 1).normalized();
  point.ray_down = Eigen::Vector3f(0, 0.03F, 1).normalized();
  return point;
}

}  // namespace

CameraPtr small_camera() {
  static const CameraPtr made =
      *make_camera({CameraModel::kPinholeRadtan, kWidth, kHeight, {26, 26, 16, 12, 0, 0, 0, 0, 0}});
  return made;
}

GrayImage small_image() {
  GrayImage image(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) image.row(y)[x] = static_cast<uint8_t>(8 * x ^ 5 * y);
  }
  return image;
}

MapHeader small_header() {
  MapHeader made;
  made.id.bytes.fill(7);
  made.name = "desk";
  made.epoch = Epoch{3};
  return made;
}

MapRecord small_record() {
  MapRecord made;
  made.keyframe_count = 2;
  made.point_count = kPoints;
  made.foundation = FoundationRecord{0.07, true};
  made.work = WorkRecord{{{KeyframeId{1}, 2, 777, 31}}, {PointId{1}}, KeyframeId{1}, true, false, true};
  SourcesRecord sources{0, {}};
  PositionsRecord positions{0, {}};
  for (size_t i = 0; i < kPoints; ++i) {
    sources.points.push_back(source(i));
    positions.points.push_back({{1, 2, 3.0 + static_cast<double>(i)}, 4, 2, true});
  }
  for (const KeyframeId id : {KeyframeId{1}, KeyframeId{2}}) {
    KeyframeRecord keyframe{
        id, {}, small_camera(), Timestamp{17}, pose(0.1 * static_cast<double>(id.value)), 3, 1, 10};
    if (id > KeyframeId{1}) keyframe.reference = KeyframeId{1};
    made.keyframes.push_back(keyframe);
    MeasurementsRecord seen{id, {}, {}};
    for (const PointSource& point : sources.points) seen.measurements.push_back({point.id, 0, {10, 12}});
    made.measurements.push_back(std::move(seen));
    made.images.push_back({id, std::make_shared<const GrayImage>(small_image())});
  }
  made.sources.push_back(std::move(sources));
  made.positions.push_back(std::move(positions));
  return made;
}

LabelRecord small_label() {
  LabelRecord record;
  record.id = 1;
  record.text = "kettle";
  record.author = "ann";
  return record;
}

DecisionRecord small_decision() {
  DecisionRecord record;
  record.client = "ann";
  record.session = SessionId{42};
  record.seq = 7;
  record.reason = "too close";
  record.seed_points = {{TrailId{1}, PointId{1}}};
  return record;
}

}  // namespace cairn::fuzz
