// SPDX-License-Identifier: Apache-2.0
//
// A server that is killed with work left, and the next one that does it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "server/service/simulation/lone_client_fixture.h"
#include "server/store/store.h"

namespace cairn::simulation {
namespace {

using nlohmann::json;
using ::testing::Each;
using ::testing::IsEmpty;
using ::testing::Lt;
using ::testing::Not;
using ::testing::SizeIs;

class Killed : public LoneClientFixture {
 protected:
  /// How far to the right live points are that were made after the first `made`, ascending.
  [[nodiscard]] static std::vector<double> xs_of(const MapSnapshot& map, size_t made) {
    std::vector<double> xs;
    for (const auto& block : map.point_blocks) {
      for (int slot = 0; slot < block->count; ++slot) {
        const PointId id = block->source(slot).id;
        if (id.value > made && map.find(id)) xs.push_back(block->position(slot).x());
      }
    }
    std::ranges::sort(xs);
    return xs;
  }
  /// Until its client is told what came of the offer, and not a task more.
  [[nodiscard]] bool run_until_told(const wire::KeyframeOffer& offer) {
    while (!reason_of(offer) && server_->run_something()) continue;
    return reason_of(offer) == "";
  }
  [[nodiscard]] StoredMap kept() {
    const auto store = Store::open(directory_.path(), null_logger());
    EXPECT_TRUE(store) << store.error().message;
    auto map = (*store)->load(map_);
    EXPECT_TRUE(map) << map.error().message;
    return std::move(*map);
  }
};

TEST_F(Killed, AKeyframeThatLacksPointsIsHeldToItsExtentByTheNextServer) {
  const MapSnapshotPtr before = snapshot_;
  wire::KeyframeOffer offer = sound_offer(6);
  const SE3 camera = offer.camera_from_reference * before->find(offer.reference)->camera_from_map;
  const std::vector<double> xs = xs_of(*before, 0);
  // What the frame shows anew lies on either side of it.
  const double most = 0.75 * xs.back();
  ASSERT_LT(camera.center().x(), most);
  const json box{{-100, -100, -100}, {most, 100, 100}};
  ASSERT_EQ(ask(json{{"verb", "rights-grant"},
                     {"to", kClient},
                     {"map", to_hex(map_.bytes)},
                     {"right", "write"},
                     {"within", {{"box", box}}}}
                    .dump()),
            "");
  settle();  // nothing waits to be kept

  send(&offer);
  ASSERT_TRUE(run_until_told(offer)) << reason_of(offer).value_or("nothing is said of it");
  server_->kill();
  const StoredMap left = kept();
  ASSERT_TRUE(left.record.work);
  ASSERT_THAT(left.record.work->wanting_points, SizeIs(1)) << "or this tests nothing";
  ASSERT_FALSE(left.record.work->wanting_points[0].extent == std::nullopt);

  begin();
  server_->peers().want(kClient, map_);
  settle();
  ASSERT_EQ(snapshot_->keyframe_count(), before->keyframe_count() + 1);
  const std::vector<double> made = xs_of(*snapshot_, left.record.point_count);
  EXPECT_THAT(made, Not(IsEmpty())) << "it makes points still";
  constexpr double kMoved = 0.02;  // by adjustments since
  EXPECT_THAT(made, Each(Lt(most + kMoved)));
}

}  // namespace
}  // namespace cairn::simulation
