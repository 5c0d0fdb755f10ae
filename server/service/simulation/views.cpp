// SPDX-License-Identifier: Apache-2.0
#include "server/service/simulation/views.h"

#include <array>
#include <utility>

#include "common/image/corners.h"

namespace cairn::simulation {
namespace {

using testing::Scene;

CameraPtr small_camera() {
  CameraParameters p;
  p.width = 160;
  p.height = 120;
  p.values = {132, 132, 79.5, 59.5, -0.08, 0.02, 0, 0};
  return *make_camera(p);
}

wire::ImageMessage raw(const GrayImage& image) {
  wire::ImageMessage message;
  message.width = static_cast<uint32_t>(image.width());
  message.height = static_cast<uint32_t>(image.height());
  for (int y = 0; y < image.height(); ++y)
    message.bytes.insert(message.bytes.end(), image.row(y), image.row(y) + image.width());
  return message;
}

PlaceView described(const GrayImage& image) {
  Pyramid pyramid;
  pyramid.build(image.view());
  return describe_place(pyramid, detect_corners(pyramid));
}

}  // namespace

const Views& Views::of_place(size_t place) {
  static const std::array<Views, kPlaces> kAll{Views(11), Views(12)};
  return kAll[place];
}

Views::Views(uint64_t scene) : scene_(scene, small_camera()) {
  for (int step = 0; step < kSteps; ++step) {
    images_.push_back(scene_.render(Scene::pose(step), static_cast<uint64_t>(step)));
    places_.push_back(described(*images_.back()));
  }
  const SE3 first = Scene::pose(0);
  const SE3 second = Scene::pose(testing::kSecondStep);
  SeedInput input;
  input.camera = scene_.camera();
  input.trails = testing::make_trails(scene_, *images_[0], first, second);
  seed_.trails = input.trails;
  seed_.second_from_first = testing::motion_between(input, second * first.inverse());
  seed_.first_image = raw(*images_[0]);
  seed_.second_image = raw(*images_[testing::kSecondStep]);
}

wire::MapSeed Views::seed() const {
  return seed_;
}

std::optional<wire::KeyframeOffer> Views::offer(const MapSnapshot& map, int step) const {
  if (map.find(KeyframeId{1}) == nullptr || map.find(KeyframeId{2}) == nullptr) return std::nullopt;
  const GrayImagePtr& image = images_[static_cast<size_t>(step)];
  KeyframeInput input = testing::make_offer(scene_, map, step, image);
  wire::KeyframeOffer offer;
  offer.map = map.map;
  offer.epoch = map.epoch;
  offer.revision = map.revision;
  offer.reference = input.reference;
  offer.camera_from_reference = input.camera_from_reference;
  offer.measurements = std::move(input.measurements);
  offer.image = raw(*image);
  return offer;
}

wire::RelocQuery Views::query(int step) const {
  const PlaceView& place = places_[static_cast<size_t>(step)];
  wire::RelocQuery query;
  query.small_image = raw(place.small);
  query.corners = place.corners;
  return query;
}

SE3 Views::motion(int from_step, int to_step, const MapSnapshot& map) {
  const Similarity3 world_from_map = testing::world_from_map(map);
  const SE3 motion = Scene::pose(to_step) * Scene::pose(from_step).inverse();
  return {motion.rotation(), motion.translation() / world_from_map.scale()};
}

}  // namespace cairn::simulation
