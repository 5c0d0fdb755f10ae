// SPDX-License-Identifier: Apache-2.0
#include "server/service/turn_thread.h"

#include <exception>
#include <utility>

namespace cairn {
namespace {

constexpr std::chrono::milliseconds kPause{500};  // after a turn that threw: memory may come back

}  // namespace

void TurnThread::begin(Turn turn) {
  thread_ = std::thread([this, turn = std::move(turn)] { run(turn); });
}

void TurnThread::wake() {
  {
    const std::scoped_lock lock(mutex_);
    is_woken_ = true;
  }
  wake_.notify_one();
}

void TurnThread::finish() {
  {
    const std::scoped_lock lock(mutex_);
    finishing_ = true;
  }
  wake_.notify_one();
  if (thread_.joinable()) thread_.join();
}

void TurnThread::run(const Turn& turn) {
  const auto has_work = [this] { return is_woken_ || finishing_; };
  std::optional<MonotonicTime> next;
  int failures = 0;  // one after another, in finish()
  std::unique_lock lock(mutex_);
  while (true) {
    if (next) {
      wake_.wait_until(lock, *next, has_work);
    } else {
      wake_.wait(lock, has_work);
    }
    if (!std::exchange(is_woken_, false) && finishing_) return;
    lock.unlock();
    const bool is_taken = take(turn, &next);
    if (!is_taken) std::this_thread::sleep_for(kPause);
    lock.lock();
    if (!is_taken) is_woken_ = true;  // what the turn was woken for still waits
    failures = is_taken || !finishing_ ? 0 : failures + 1;
    if (failures == kLastAttempts)
      return log_->error("{} was given up at the end; what still waited for it is lost", name_);
  }
}

bool TurnThread::take(const Turn& turn, std::optional<MonotonicTime>* next) const {
  try {
    *next = turn();
    return true;
  } catch (const std::exception& problem) {
    log_->error(
        "{} failed: {}; it is tried again soon. If this repeats, make room (memory, disk) and restart the "
        "server",
        name_, problem.what());
    return false;
  }
}

}  // namespace cairn
