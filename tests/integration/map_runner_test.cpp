// SPDX-License-Identifier: Apache-2.0
// A map at work: what it does is counted, and when its work fails every job is answered all the same.
#include "server/service/map_runner.h"
#include "server/service/system_clock.h"
#include "server/service/worker_pool.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <new>
#include <nlohmann/json.hpp>

#include "client/session/image_encoder.h"
#include "server/service/work_times_json.h"
#include "tests/integration/two_views.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;

constexpr std::chrono::seconds kDeadline{60};

/// The answer to one job.
template <typename Answer>
Answer value_of(std::future<Answer> answer) {
  if (answer.wait_for(kDeadline) != std::future_status::ready) throw std::runtime_error("no answer");
  return answer.get();
}

class MapRunnerTest : public ::testing::Test {
 protected:
  MapRunnerTest()
      : runner_(std::make_shared<MapRunner>(MapRunner::Executors{urgent_, background_}, MapMakerOptions{},
                                            nullptr,
                                            MapRunner::Listener{[this](const MapRevision&) {
                                                                  if (++published_ == fails_at_)
                                                                    throw std::bad_alloc();
                                                                },
                                                                [this](const std::string&) { ++frozen_; }},
                                            std::make_shared<SystemClock>(), null_logger(), &times_)) {}
  ~MapRunnerTest() override {
    runner_->stop();
    urgent_.stop();
    background_.stop();
  }

  std::pair<Result<SeedResult>, MapSnapshotPtr> start() {
    const SeedProposal proposal = testing::make_seed(scene_);
    SeedJob job;
    job.input.map = MapId{{1}};
    job.input.epoch = {1};
    job.input.camera = scene_.camera();
    job.input.trails = proposal.trails;
    job.input.second_from_first = proposal.second_from_first;
    job.first_image = encode_image(*proposal.first_image, wire::ImageEncoding::kRaw);
    job.second_image = encode_image(*proposal.second_image, wire::ImageEncoding::kRaw);
    job.lockstep = true;
    auto answered = std::make_shared<std::promise<std::pair<Result<SeedResult>, MapSnapshotPtr>>>();
    auto answer = answered->get_future();
    runner_->start(std::move(job), [answered](Result<SeedResult> result, MapSnapshotPtr snapshot) {
      answered->set_value({std::move(result), std::move(snapshot)});
    });
    return value_of(std::move(answer));
  }

  OfferJudgement offer(const MapSnapshot& map, int step) { return value_of(send_offer(map, step, true)); }

  std::future<OfferJudgement> send_offer(const MapSnapshot& map, int step, bool lockstep) {
    return send(job_of(map, step, lockstep));
  }

  OfferJob job_of(const MapSnapshot& map, int step, bool lockstep) {
    const testing::Frame frame = testing::make_offer(scene_, map, step);
    OfferJob job;
    job.input.camera = scene_.camera();
    job.input.reference = frame.proposal.reference;
    job.input.camera_from_reference = frame.proposal.camera_from_reference;
    job.input.measurements = frame.proposal.measurements;
    job.epoch = map.epoch;
    job.image = encode_image(*frame.image, wire::ImageEncoding::kRaw);
    job.lockstep = lockstep;
    return job;
  }

  std::future<OfferJudgement> send(OfferJob job) {
    auto answered = std::make_shared<std::promise<OfferJudgement>>();
    auto answer = answered->get_future();
    runner_->offer(std::move(job),
                   [answered](OfferJudgement judgement) { answered->set_value(std::move(judgement)); });
    return answer;
  }

  testing::Scene scene_{11};
  std::atomic<int> published_{0};
  std::atomic<int> fails_at_{0};
  std::atomic<int> frozen_{0};
  WorkTimes times_;
  WorkerPool urgent_{1, 0, null_logger()};
  WorkerPool background_{1, 0, null_logger()};
  std::shared_ptr<MapRunner> runner_;
};

TEST_F(MapRunnerTest, ASeedWhoseWorkFailsIsAnswered) {
  fails_at_ = 1;
  const auto [result, snapshot] = start();
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ErrorCode::kInternal);
  EXPECT_THAT(result.error().message, HasSubstr("internal error"));
  EXPECT_EQ(snapshot, nullptr);
}

TEST_F(MapRunnerTest, AnOfferWhoseWorkFailsIsAnsweredAndTheMapStaysAsPublished) {
  const auto [result, snapshot] = start();
  ASSERT_TRUE(result) << result.error().message;
  fails_at_ = published_ + 1;
  for (const int step : {4, 6}) {
    const OfferJudgement judgement = offer(*snapshot, step);
    EXPECT_EQ(judgement.decision, wire::OfferDecision::kDamaged);
    EXPECT_THAT(judgement.reason, HasSubstr("internal error"));
    EXPECT_EQ(judgement.revision, snapshot->revision);
  }
  EXPECT_EQ(published_.load(), fails_at_.load()) << "frozen: nothing came after";
  EXPECT_EQ(frozen_.load(), 1) << "and said so";
}

TEST_F(MapRunnerTest, WhatIsDoneIsCounted) {
  const auto [result, snapshot] = start();
  ASSERT_TRUE(result) << result.error().message;
  const auto count = [this](const char* what) {
    return nlohmann::json::parse(to_json(times_.summaries())).at(what).at("count").get<int>();
  };
  EXPECT_EQ(count("offer_waited_ms"), 0);
  const int seeds_points = count("new_points_cpu_ms");
  EXPECT_EQ(offer(*snapshot, 5).decision, wire::OfferDecision::kAccepted);
  EXPECT_EQ(offer(*snapshot, 5).decision, wire::OfferDecision::kTooClose);
  EXPECT_EQ(count("offer_waited_ms"), 2);
  EXPECT_EQ(count("offer_judged_cpu_ms"), 2);
  EXPECT_EQ(count("new_points_cpu_ms"), seeds_points + 1);
  EXPECT_GE(count("local_adjustment_cpu_ms"), 1);
  EXPECT_GE(count("global_adjustment_observations"), 1);
  EXPECT_EQ(count("offer_to_points_ms"), 1);
}

TEST_F(MapRunnerTest, AnOfferThatWasWithdrawnWhileItWaitedIsNotTaken) {
  const auto [result, snapshot] = start();
  ASSERT_TRUE(result) << result.error().message;
  OfferJob job = job_of(*snapshot, 5, true);
  PendingOffers offers;
  const auto bytes = std::make_shared<std::atomic<size_t>>(0);
  job.pending = offers.add({PendingOffers::Kind::kKeyframe, MapId{{1}}, {}}, 1, bytes);
  offers.withdraw([](const PendingOffers::What&) { return true; });
  const OfferJudgement judgement = value_of(send(std::move(job)));
  EXPECT_EQ(judgement.decision, wire::OfferDecision::kNoRight);
  EXPECT_THAT(judgement.reason, HasSubstr("has changed while its keyframe waited"));
  job = job_of(*snapshot, 5, true);
  job.pending = offers.add({PendingOffers::Kind::kKeyframe, MapId{{1}}, {}}, 1, bytes);
  EXPECT_EQ(value_of(send(std::move(job))).decision, wire::OfferDecision::kAccepted);
}

/// Offers of a client that was cut off: the second was tracked against the first, and measures nothing that
/// the map had before.
TEST_F(MapRunnerTest, AnOfferMayReferToAnEarlierOneOfItsSession) {
  const auto [result, snapshot] = start();
  ASSERT_TRUE(result) << result.error().message;
  const auto chained = [&, map = snapshot](uint64_t session, uint64_t reference, int step,
                                           int reference_step) {
    OfferJob job = job_of(*map, step, true);
    const OfferJob earlier = job_of(*map, reference_step, true);
    const SE3 camera_from_map =
        job.input.camera_from_reference * map->find(job.input.reference)->camera_from_map;
    const SE3 earlier_from_map =
        earlier.input.camera_from_reference * map->find(earlier.input.reference)->camera_from_map;
    job.origin = {"anna", {SessionId{session}, reference + 1}};
    job.input.reference = {};
    job.input.camera_from_reference = camera_from_map * earlier_from_map.inverse();
    job.input.measurements.clear();
    job.reference_command = reference;
    return job;
  };
  OfferJob first = job_of(*snapshot, 4, true);
  first.origin = {"anna", {SessionId{5}, 1}};
  ASSERT_EQ(value_of(send(std::move(first))).decision, wire::OfferDecision::kAccepted);
  EXPECT_EQ(value_of(send(chained(6, 1, 6, 4))).decision, wire::OfferDecision::kStale) << "another session's";
  EXPECT_EQ(value_of(send(chained(5, 7, 6, 4))).decision, wire::OfferDecision::kStale) << "never seen";
  const OfferJudgement second = value_of(send(chained(5, 1, 6, 4)));
  EXPECT_EQ(second.decision, wire::OfferDecision::kAccepted) << second.reason;
  EXPECT_EQ(value_of(send(chained(5, 2, 8, 6))).decision, wire::OfferDecision::kAccepted);
}

TEST_F(MapRunnerTest, WhatWaitsWhenTheMapIsDeletedIsAnsweredWithThat) {
  const auto [result, snapshot] = start();
  ASSERT_TRUE(result) << result.error().message;
  std::promise<void> release;
  urgent_.submit([&] { release.get_future().wait(); });  // its only worker
  std::vector<std::future<OfferJudgement>> offers;
  for (const int step : {4, 6}) offers.push_back(send_offer(*snapshot, step, step == 6));
  auto renamed = std::make_shared<std::promise<Status>>();
  runner_->rename("bench", [renamed](Status kept) { renamed->set_value(std::move(kept)); });
  auto flushed = std::make_shared<std::promise<bool>>();
  runner_->flush([flushed](const Status&) { flushed->set_value(true); });
  runner_->retire();
  release.set_value();
  for (auto& offer : offers) {
    const OfferJudgement judgement = value_of(std::move(offer));
    EXPECT_EQ(judgement.decision, wire::OfferDecision::kUnknownMap);
    EXPECT_THAT(judgement.reason, HasSubstr("deleted"));
  }
  EXPECT_FALSE(value_of(renamed->get_future()));
  EXPECT_TRUE(value_of(flushed->get_future()));
}

}  // namespace
}  // namespace cairn
