// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>

#include "common/wire/messages.h"
#include "server/mapping/map_maker_fixture.h"

namespace cairn::simulation {

/// What small cameras see of a place, and send of it. Rendered once for all runs of a process.
class Views {
 public:
  static constexpr size_t kPlaces = 2;
  static constexpr int kSteps = 14;  ///< Scene::pose(0..kSteps-1)
  [[nodiscard]] static const Views& of_place(size_t place);

  [[nodiscard]] CameraPtr camera() const { return scene_.camera(); }
  /// A seed of the first two views, without who sends it.
  [[nodiscard]] wire::MapSeed seed() const;
  /// A frame that was tracked on a revision of a map that seed() made; nothing: its first keyframes, by which
  /// the frame's true pose is found, are not in it any more.
  [[nodiscard]] std::optional<wire::KeyframeOffer> offer(const MapSnapshot& map, int step) const;
  [[nodiscard]] wire::RelocQuery query(int step) const;
  [[nodiscard]] static SE3 motion(int from_step, int to_step, const MapSnapshot& map);

 private:
  explicit Views(uint64_t scene);
  testing::Scene scene_;
  std::vector<GrayImagePtr> images_;
  std::vector<PlaceView> places_;
  wire::MapSeed seed_;
};

}  // namespace cairn::simulation
