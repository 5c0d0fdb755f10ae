// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <functional>
#include <initializer_list>
#include <memory>

#include "common/wire/topic.h"

namespace cairn::wire {

/// Waits for data at any of several readers, or for a call from another thread. wake() is thread-safe, the
/// rest belongs to the waiting thread. Readers may be destroyed while attached.
class Waiter {
 public:
  [[nodiscard]] static Result<Waiter> create(const Participant& participant);
  Waiter(Waiter&&) noexcept;
  Waiter& operator=(Waiter&&) noexcept;
  ~Waiter();

  [[nodiscard]] Status attach(std::initializer_list<std::reference_wrapper<const ReaderBase>> readers);
  /// Waits until an attached reader has something to take, wake() was called (also before this call), or the
  /// time is over. False only for the last.
  bool wait(std::chrono::milliseconds timeout);
  void wake();

 private:
  struct State;
  explicit Waiter(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace cairn::wire
