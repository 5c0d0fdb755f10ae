// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <vector>

#include "server/relocalization/exact_map.h"
#include "server/relocalization/place_index.h"

namespace cairn::testing {

inline std::vector<const IndexedMap*> all_maps(const PlaceIndex& index) {
  std::vector<const IndexedMap*> maps;
  for (const IndexedMapPtr& map : index.maps()) maps.push_back(map.get());
  return maps;
}

/// Two mapped places; rendering them takes most of the time, so all tests share them.
struct Places {
  Scene scene{11};
  Scene other_scene{12};
  ExactMap map{scene, 1, {0, 4, 8}};
  ExactMap other_map{other_scene, 2, {0, 4, 8}};
};

/// An index of both.
class PlacesTest : public ::testing::Test {
 protected:
  PlacesTest() {
    static const Places places;
    places_ = &places;
    index_.put(map().index());
    index_.put(places_->other_map.index());
  }
  [[nodiscard]] const Scene& scene() const { return places_->scene; }
  [[nodiscard]] const ExactMap& map() const { return places_->map; }

  const Places* places_ = nullptr;
  PlaceIndex index_;
};

}  // namespace cairn::testing
