// SPDX-License-Identifier: Apache-2.0
// Versions of a map while people use it: a roll-back is another epoch, in which all go on.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/store/sqlite.h"
#include "tests/integration/administered_fixture.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using ::testing::Contains;
using testing::eventually;
using ::testing::HasSubstr;

class VersionsTest : public testing::AdministeredFixture {
 protected:
  /// Of the map's file, by another program or the disk.
  void damage(const std::string& sql) const {
    const auto file = service_options_.store / ("maps/" + to_hex(map_.bytes) + ".cairnmap");
    auto database = sqlite::Database::open(file, sqlite::OpenMode::kReadWrite);
    ASSERT_TRUE(database && database->execute(sql));
  }
  [[nodiscard]] std::optional<OfferReply> offer(const MapSnapshot& tracked_in, int step,
                                                KeyframeId reference = {}) {
    testing::Frame frame = testing::make_offer(scene_, tracked_in, step);
    if (reference) {
      const SE3 camera_from_map =
          frame.proposal.camera_from_reference * tracked_in.find(frame.proposal.reference)->camera_from_map;
      frame.proposal.camera_from_reference =
          camera_from_map * tracked_in.find(reference)->camera_from_map.inverse();
      frame.proposal.reference = reference;
    }
    anna_->send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{step});
    std::vector<OfferReply> replies;
    (void)eventually([&] { return !(replies = anna_->take_offer_replies()).empty(); });
    return replies.size() == 1 ? std::optional(replies.front()) : std::nullopt;
  }
  void grow(int step) {
    const size_t before = anna_->snapshot()->keyframe_count();
    const auto reply = offer(*anna_->snapshot(), step);
    ASSERT_TRUE(reply && reply->accepted) << (reply ? reply->reason : "no reply");
    ASSERT_TRUE(eventually([&] { return anna_->snapshot()->keyframe_count() == before + 1; }));
  }
  void roll_back(const std::string& tag) {
    const Epoch before = anna_->snapshot()->epoch;
    done({{"verb", "roll-back"}, {"map", "map-1"}, {"tag", tag}});
    ASSERT_TRUE(eventually([&] { return anna_->snapshot()->epoch > before; }));
  }
};

TEST_F(VersionsTest, ARollBackIsAnotherEpochInWhichClientsAndLabelsGoOn) {
  make_map();
  const auto bob = open("bob");
  bob->use_map(map_);
  ASSERT_TRUE(bob->wait_for_map(60s));
  const LabelId vice = add(*anna_, "vice");
  grow(4);
  const size_t keyframes = anna_->snapshot()->keyframe_count();
  EXPECT_EQ(done({{"verb", "tag"}, {"map", "map-1"}, {"tag", "monday"}})["keyframes"], keyframes);

  grow(8);
  ASSERT_TRUE(ask(*anna_, request_label_text(map_, vice, "small vice"))->done);
  (void)add(*anna_, "lathe");
  ASSERT_TRUE(eventually([&] { return texts(*bob) == (Texts{"small vice", "lathe"}); }));
  const MapSnapshotPtr before = anna_->snapshot();
  roll_back("monday");
  EXPECT_TRUE(eventually([&] { return anna_->snapshot()->keyframe_count() == keyframes; }));
  EXPECT_TRUE(eventually([&] { return texts(*bob) == Texts{"vice"} && texts(*anna_) == Texts{"vice"}; }));
  EXPECT_TRUE(eventually([&] { return bob->snapshot()->epoch == anna_->snapshot()->epoch; }));
  EXPECT_EQ(anna_->status().link, ServerLink::kConnected);

  // What was tracked just before is taken in where what it was tracked on is there still, and never by ids
  // that are another's now.
  const auto in_flight = offer(*before, 12);
  ASSERT_TRUE(in_flight);
  EXPECT_TRUE(in_flight->accepted || in_flight->reason.find("epoch") != std::string::npos)
      << in_flight->reason;
  (void)add(*anna_, "drill");
  EXPECT_TRUE(eventually([&] { return texts(*bob) == (Texts{"vice", "drill"}); }));

  grow(8);
  const MapSnapshotPtr between = anna_->snapshot();
  const KeyframeId another{keyframes + 1};
  ASSERT_NE(between->find(another), nullptr);
  roll_back("before-rollback-1");
  EXPECT_TRUE(eventually([&] { return anna_->snapshot()->keyframe_count() == before->keyframe_count(); }));
  EXPECT_TRUE(eventually([&] { return texts(*bob) == (Texts{"small vice", "lathe"}); }));
  ASSERT_NE(anna_->snapshot()->find(another), nullptr) << "it is there, and is not the one of between";
  const auto by_another = offer(*between, 14, another);
  ASSERT_TRUE(by_another);
  EXPECT_FALSE(by_another->accepted);
  EXPECT_THAT(by_another->reason, HasSubstr("epoch"));
  grow(14);
}

TEST_F(VersionsTest, WhatWasRolledBackIsWhatAnotherStartFinds) {
  make_map();
  grow(4);
  const size_t keyframes = anna_->snapshot()->keyframe_count();
  done({{"verb", "tag"}, {"map", "map-1"}, {"tag", "monday"}});
  grow(8);
  roll_back("monday");
  grow(6);
  const Epoch epoch = anna_->snapshot()->epoch;
  service_.reset();
  start_service_again();
  ASSERT_TRUE(eventually([&] { return anna_->snapshot()->epoch > epoch; }));
  EXPECT_TRUE(eventually([&] { return anna_->snapshot()->keyframe_count() == keyframes + 1; }));
}

TEST_F(VersionsTest, AMapThatCannotBeRolledBackGoesOn) {
  make_map();
  const json back_to_monday{{"verb", "roll-back"}, {"map", "map-1"}, {"tag", "monday"}};
  const auto refused = admin_->ask(back_to_monday);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("no tag 'monday'"));
  done({{"verb", "tag"}, {"map", "map-1"}, {"tag", "monday"}});
  grow(4);
  const Epoch epoch = anna_->snapshot()->epoch;
  damage("UPDATE images SET checksum = checksum + 1 WHERE id = 1");
  const auto damaged = admin_->ask(back_to_monday);
  damage("UPDATE images SET checksum = checksum - 1 WHERE id = 1");
  ASSERT_FALSE(damaged) << "it has an image of the tag's";
  EXPECT_THAT(damaged.error().message, HasSubstr("table images, row 1"));
  EXPECT_EQ(done({{"verb", "tags"}, {"map", "map-1"}})["tags"].size(), 1U) << "nothing has happened";
  EXPECT_EQ(done({{"verb", "status"}})["damaged_files"], 0);
  (void)add(*anna_, "vice");
  const auto copy = done({{"verb", "copy"}, {"map", "map-1"}, {"name", "twin"}});
  EXPECT_EQ(copy["keyframes"], anna_->snapshot()->keyframe_count());
  grow(8);
  EXPECT_EQ(anna_->snapshot()->epoch, epoch);
  const auto audit = done({{"verb", "audit"}})["entries"];
  std::vector<std::string> outcomes;
  for (const auto& entry : audit)
    outcomes.push_back(entry["action"].get<std::string>() + ": " + entry["object"].get<std::string>());
  EXPECT_THAT(outcomes, Contains("roll back: map map-1, tag monday"));
  EXPECT_THAT(outcomes, Contains("copy: map map-1, name twin"));
}

}  // namespace
}  // namespace cairn
