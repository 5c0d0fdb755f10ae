// SPDX-License-Identifier: Apache-2.0
#include "server/service/strand.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <atomic>
#include <future>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <vector>

#include "server/service/turn_thread.h"
#include "server/service/worker_pool.h"

namespace cairn {
namespace {

constexpr std::chrono::seconds kDeadline{60};

/// Set by the last task; waiting has a deadline.
class Done {
 public:
  void set() { promise_.set_value(); }
  [[nodiscard]] bool wait() { return future_.wait_for(kDeadline) == std::future_status::ready; }

 private:
  std::promise<void> promise_;
  std::future<void> future_ = promise_.get_future();
};

TEST(Strand, ManyQueuesUnderLoadEachKeepTheirOrderAndNeverOverlap) {
  constexpr int kQueues = 16;
  constexpr int kTasks = 2000;
  struct Map {
    std::vector<int> order;  // not synchronized: the queue is
    std::atomic<int> inside{0};
  };
  std::vector<Map> maps(kQueues);
  std::atomic<int> left{kQueues * kTasks};
  std::atomic<bool> overlap{false};
  Done done;
  WorkerPool pool(4, 0, null_logger());
  std::vector<Strand> queues;
  queues.reserve(kQueues);
  for (int q = 0; q < kQueues; ++q) queues.emplace_back(pool);
  for (int t = 0; t < kTasks; ++t) {
    for (size_t q = 0; q < kQueues; ++q) {
      queues[q].post([&, q, t] {
        if (maps[q].inside.fetch_add(1) != 0) overlap = true;
        maps[q].order.push_back(t);
        maps[q].inside.fetch_sub(1);
        if (left.fetch_sub(1) == 1) done.set();
      });
    }
  }
  ASSERT_TRUE(done.wait());
  EXPECT_FALSE(overlap);
  for (const Map& map : maps) {
    ASSERT_EQ(map.order.size(), static_cast<size_t>(kTasks));
    EXPECT_TRUE(std::is_sorted(map.order.begin(), map.order.end()));
  }
}

TEST(Strand, DifferentQueuesRunInParallel) {
  WorkerPool pool(2, 0, null_logger());
  Strand first(pool);
  Strand second(pool);
  Done first_inside;
  Done finished;
  std::atomic<bool> met{false};
  first.post([&] {
    first_inside.set();
    met = finished.wait();  // only the other queue's task ends this
  });
  second.post([&] {
    (void)first_inside.wait();
    finished.set();
  });
  Done end;
  first.post([&] { end.set(); });
  ASSERT_TRUE(end.wait());
  EXPECT_TRUE(met);
}

TEST(Strand, ATaskThatPostsComesAfterWhatWaits) {
  WorkerPool pool(2, 0, null_logger());
  Strand queue(pool);
  std::vector<int> order;
  Done filled;
  Done done;
  queue.post([&] {
    (void)filled.wait();
    order.push_back(1);
    queue.post([&] {
      order.push_back(3);
      done.set();
    });
  });
  queue.post([&] { order.push_back(2); });
  filled.set();
  ASSERT_TRUE(done.wait());
  EXPECT_EQ(order, (std::vector<int>{1, 2, 3}));
}

TEST(Strand, ATaskThatThrowsStopsNeitherTheQueueNorThePool) {
  WorkerPool pool(1, 0, null_logger());
  Strand queue(pool);
  Done done;
  queue.post([] { throw std::runtime_error("broken"); });
  queue.post([&] { done.set(); });
  EXPECT_TRUE(done.wait());
}

/// Before, that ended the program.
TEST(OnThreads, WhatOneOfThemThrowsIsThrownByAllTogether) {
  std::atomic<int> begun{0};
  EXPECT_THROW(on_threads(3)([&] {
                 if (++begun == 2) throw std::runtime_error("broken");
               }),
               std::runtime_error);
  EXPECT_EQ(begun, 3);
}

/// Before, that ended the program, with all that waited to be written.
TEST(TurnThread, ATurnThatThrowsIsTakenAgainUnasked) {
  std::ostringstream said;
  std::atomic<int> turns{0};
  Done done;
  {
    TurnThread thread(
        "the writer of the store",
        std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::ostream_sink_mt>(said)));
    thread.begin([&]() -> std::optional<MonotonicTime> {
      if (++turns == 1) throw std::runtime_error("broken");
      if (turns == 2) done.set();
      return std::nullopt;
    });
    EXPECT_TRUE(done.wait());
  }
  EXPECT_EQ(turns, 2) << "it waits for a reason then";
  EXPECT_THAT(said.str(), ::testing::HasSubstr("the writer of the store failed: broken"));
}

TEST(TurnThread, TheEndTriesAgainButNotForEver) {
  std::atomic<int> turns{0};
  Done begun;
  {
    TurnThread thread("a thread", null_logger());
    thread.begin([&]() -> std::optional<MonotonicTime> {
      if (++turns > 1) throw std::runtime_error("broken");
      begun.set();
      return std::nullopt;
    });
    ASSERT_TRUE(begun.wait());
    thread.finish();
  }
  EXPECT_EQ(turns, 1) << "nothing was asked for";
  turns = 0;
  {
    TurnThread thread("a thread", null_logger());
    thread.begin([&]() -> std::optional<MonotonicTime> {
      ++turns;
      throw std::runtime_error("broken");
    });
    thread.finish();
  }
  EXPECT_GE(turns, TurnThread::kLastAttempts);
  EXPECT_LE(turns, TurnThread::kLastAttempts + 1) << "one may have come before the end";
}

TEST(WorkerPool, UrgentTasksComeFirstAndAreSeenToWait) {
  WorkerPool pool(1, 0, null_logger());
  std::vector<int> order;
  Done inside;
  Done filled;
  Done done;
  pool.submit([&] {
    inside.set();
    (void)filled.wait();
    order.push_back(pool.urgent_waits() ? 0 : -1);
  });
  ASSERT_TRUE(inside.wait());
  EXPECT_FALSE(pool.urgent_waits());
  pool.submit([&] {
    order.push_back(pool.urgent_waits() ? -1 : 3);
    done.set();
  });
  pool.submit([&] { order.push_back(1); }, Urgency::kUrgent);
  pool.submit([&] { order.push_back(2); }, Urgency::kUrgent);
  filled.set();
  ASSERT_TRUE(done.wait());
  EXPECT_EQ(order, (std::vector<int>{0, 1, 2, 3}));
}

TEST(Strand, AnUrgentTaskHurriesTheQueueThatItWaitsIn) {
  WorkerPool pool(1, 0, null_logger());
  Strand busy(pool);
  Strand hurried(pool);
  std::vector<int> order;
  Done filled;
  Done done;
  pool.submit([&] { (void)filled.wait(); });
  for (int i = 0; i < 2; ++i) busy.post([&] { order.push_back(9); });
  hurried.post([&] { order.push_back(1); });
  hurried.post([&] { order.push_back(2); }, Urgency::kUrgent);
  hurried.post([&] {
    order.push_back(3);
    if (order.size() == 5) done.set();
  });
  busy.post([&] {
    order.push_back(9);
    if (order.size() == 6) done.set();
  });
  filled.set();
  Done end;
  pool.submit([&] { hurried.post([&] { busy.post([&] { end.set(); }); }); });
  ASSERT_TRUE(end.wait());
  ASSERT_EQ(order.size(), 6U);
  EXPECT_EQ(order[0], 1) << "what is before the urgent task goes before it";
  EXPECT_EQ(order[1], 2);
}

TEST(WorkerPool, TheBackgroundExecutorDoesNotHoldUpTheOther) {
  WorkerPool urgent(1, 0, null_logger());
  WorkerPool background(1, 10, null_logger());
  Done release;
  Done background_end;
  background.submit([&] {
    (void)release.wait();
    background_end.set();
  });
  Done urgent_end;
  urgent.submit([&] { urgent_end.set(); });
  EXPECT_TRUE(urgent_end.wait());
  release.set();
  EXPECT_TRUE(background_end.wait());
}

TEST(Strand, AClosedQueueLetsGoOfWhatWaitsInIt) {
  WorkerPool pool(1, 0, null_logger());
  // As a map does: its tasks hold it, and it holds the queue.
  struct Map {
    explicit Map(WorkerPool& p) : queue(p) {}
    Strand queue;
  };
  auto map = std::make_shared<Map>(pool);
  const std::weak_ptr<Map> observed = map;
  Done inside;
  Done release;
  map->queue.post([&] {
    inside.set();
    (void)release.wait();
  });
  ASSERT_TRUE(inside.wait());
  map->queue.post([map] {});
  pool.submit([&map] { map->queue.post([map] {}); });
  map->queue.close();
  map->queue.post([map] {});
  release.set();
  pool.stop();
  map.reset();
  EXPECT_TRUE(observed.expired());
}

TEST(WorkerPool, ExecutorsThatSubmitToEachOtherMayBeStoppedInAnyOrder) {
  for (int round = 0; round < 50; ++round) {
    WorkerPool urgent(2, 0, null_logger());
    WorkerPool background(1, 0, null_logger());
    std::atomic<int> turns{0};
    std::function<void()> there;
    std::function<void()> back = [&] { urgent.submit(there); };
    there = [&] {
      ++turns;
      background.submit(back);
    };
    urgent.submit(there);
    while (turns < 10) std::this_thread::yield();
    (round % 2 == 0 ? urgent : background).stop();
    (round % 2 == 0 ? background : urgent).stop();
    const int at_end = turns;
    urgent.submit(there);
    background.submit(back);
    EXPECT_EQ(turns, at_end) << "nothing runs after stop()";
  }
}

TEST(WorkerPool, WhatWaitsIsDoneBeforeItFinishesAndDroppedWhereItIsStopped) {
  for (const bool finishes : {true, false}) {
    WorkerPool pool(1, 0, null_logger());
    std::promise<void> entered;
    std::promise<void> open;
    std::atomic<int> done = 0;
    pool.submit([&, gate = open.get_future().share()] {
      entered.set_value();
      gate.wait();
    });
    entered.get_future().wait();
    for (int i = 0; i < 10; ++i)
      pool.submit([&] { ++done; }, i % 2 == 0 ? Urgency::kUrgent : Urgency::kNormal);
    std::thread ends([&] { finishes ? pool.finish() : pool.stop(); });
    while (pool.urgent_waits() != finishes) std::this_thread::yield();
    open.set_value();
    ends.join();
    EXPECT_EQ(done, finishes ? 10 : 0);
  }
}

TEST(WorkerPool, LoadIsTheShareOfBusyTime) {
  WorkerPool pool(1, 0, null_logger());
  Done done;
  (void)pool.take_load();
  pool.submit([] {
    const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(50);
    while (std::chrono::steady_clock::now() < end) {
    }
  });
  pool.submit([&] { done.set(); });
  ASSERT_TRUE(done.wait());
  const float load = pool.take_load();
  EXPECT_GT(load, 0.1F);
  EXPECT_LE(load, 1.0F);
}

}  // namespace
}  // namespace cairn
