// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <mutex>
#include <thread>

#include "server/service/executor.h"

namespace cairn {

/// A thread that takes turns, by the steady clock of this machine.
class TurnThread : public Turns {
 public:
  TurnThread() = default;
  ~TurnThread() override { finish(); }
  TurnThread(const TurnThread&) = delete;
  TurnThread& operator=(const TurnThread&) = delete;

  void begin(Turn turn) override;
  void wake() override;
  void finish() override;

 private:
  void run(const Turn& turn);

  std::mutex mutex_;
  std::condition_variable wake_;
  bool is_woken_ = true;
  bool finishing_ = false;
  std::thread thread_;
};

}  // namespace cairn
