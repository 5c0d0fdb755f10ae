// SPDX-License-Identifier: Apache-2.0
// What a session keeps of the maps that it was in: switching back to one of the last four takes no transfer.
#include <gtest/gtest.h>

#include "tests/integration/adjusted_map.h"
#include "tests/integration/test_domain.h"

namespace cairn {
namespace {

using testing::eventually;

constexpr uint32_t kBlocks = 10;
constexpr unsigned kSeed = 77;
constexpr size_t kMaps = 5;

class RecentMaps : public ::testing::Test {
 protected:
  RecentMaps() : service_(testing::start_service(&service_options_)) {
    for (size_t i = 0; i < kMaps; ++i) {
      maps_.emplace_back(id(i), kSeed + static_cast<unsigned>(i), kBlocks);
      service_->publish(maps_[i].next());
    }
    SessionOptions options;
    options.domain = service_options_.domain;
    options.name = "anna";
    EXPECT_EQ(options.recent_maps, kMaps - 1);
    session_ = testing::open_session(options, testing::test_camera());
  }

  [[nodiscard]] static MapId id(size_t i) { return {{static_cast<uint8_t>(i + 1)}}; }
  [[nodiscard]] bool is_in(size_t i) const {
    const MapSnapshotPtr snapshot = session_->snapshot();
    return snapshot != nullptr && snapshot->map == id(i);
  }
  /// Whether it is there without any waiting.
  [[nodiscard]] bool switch_to(size_t i) const {
    session_->use_map(id(i));
    return is_in(i);
  }
  /// Switches to a map that has to come first; the bytes that came.
  [[nodiscard]] uint64_t fetch(size_t i) const {
    const uint64_t before = bytes_received();
    EXPECT_FALSE(switch_to(i)) << "map " << i;
    EXPECT_TRUE(eventually([&] { return is_in(i); })) << "map " << i;
    return bytes_received() - before;
  }
  [[nodiscard]] uint64_t bytes_received() const { return session_->status().bytes_received; }

  ServiceOptions service_options_;
  std::unique_ptr<Service> service_;
  std::vector<testing::AdjustedMap> maps_;
  std::unique_ptr<Session> session_;
};

TEST_F(RecentMaps, SwitchingBackCostsNoTransferAndTheFifthTakesThePlaceOfTheOldest) {
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  constexpr uint64_t kPatches = kBlocks * kBlockSlots * kSourcePatchSize * kSourcePatchSize;
  for (size_t i = 0; i < kMaps - 1; ++i) EXPECT_GT(fetch(i), kPatches);

  const uint64_t before = bytes_received();
  for (size_t i = 0; i < kMaps - 1; ++i) EXPECT_TRUE(switch_to(i)) << "map " << i;
  // A change comes to one that is not in use as well, and after it all that the switches have asked for.
  service_->publish(maps_[0].next());
  EXPECT_TRUE(eventually([&] { return switch_to(0) && session_->snapshot()->revision == Revision{2}; }));
  EXPECT_LT(bytes_received() - before, kPatches / 2) << "the change alone";

  EXPECT_GT(fetch(4), kPatches);
  for (const size_t kept : {2, 3, 0, 4}) EXPECT_TRUE(switch_to(kept)) << "map " << kept;
  EXPECT_GT(fetch(1), kPatches) << "the one that was not chosen for longest has gone";
  EXPECT_FALSE(switch_to(2)) << "and now the one that is the oldest since";
}

}  // namespace
}  // namespace cairn
