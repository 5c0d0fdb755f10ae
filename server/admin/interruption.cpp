// SPDX-License-Identifier: Apache-2.0
#include "server/admin/interruption.h"

#include <atomic>

namespace cairn {
namespace {

std::atomic<bool> is_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler writes it");

}  // namespace

Interruption::Interruption() {
  struct sigaction noting {};
  noting.sa_handler = [](int) {
    is_requested = true;
    for (const int next : kSignals) std::signal(next, SIG_DFL);
  };
  noting.sa_flags = SA_RESTART;
  for (size_t i = 0; i < kSignals.size(); ++i) {
    sigaction(kSignals[i], nullptr, &before_[i]);
    // nohup asks that a terminal that goes be no matter.
    if (before_[i].sa_handler != SIG_IGN) sigaction(kSignals[i], &noting, nullptr);
  }
}

Interruption::~Interruption() {
  for (size_t i = 0; i < kSignals.size(); ++i) sigaction(kSignals[i], &before_[i], nullptr);
}

bool Interruption::requested() {
  return is_requested;
}

}  // namespace cairn
