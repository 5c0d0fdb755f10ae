// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>

#include "common/base/log.h"
#include "server/service/executor.h"

namespace cairn {

/// A thread that takes turns, by the steady clock of this machine. A turn that throws is logged and taken
/// again after a pause; in finish() no more than three times, one after another.
class TurnThread : public Turns {
 public:
  static constexpr int kLastAttempts = 3;

  /// `name`: whose turns they are, for the log.
  TurnThread(std::string name, Logger log) : name_(std::move(name)), log_(std::move(log)) {}
  ~TurnThread() override { finish(); }
  TurnThread(const TurnThread&) = delete;
  TurnThread& operator=(const TurnThread&) = delete;

  void begin(Turn turn) override;
  void wake() override;
  void finish() override;

 private:
  void run(const Turn& turn);
  /// Takes a turn. False: it threw.
  [[nodiscard]] bool take(const Turn& turn, std::optional<MonotonicTime>* next) const;

  const std::string name_;
  const Logger log_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool is_woken_ = true;
  bool finishing_ = false;
  std::thread thread_;
};

}  // namespace cairn
