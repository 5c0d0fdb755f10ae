// SPDX-License-Identifier: Apache-2.0
#include "client/app/stop_signal.h"

#include <ctime>

namespace cairn {

StopSignal::StopSignal() {
  sigemptyset(&signals_);
  sigaddset(&signals_, SIGINT);
  sigaddset(&signals_, SIGTERM);
  // The terminal has gone; but nohup asks that this be no matter, and what is blocked is not ignored.
  struct sigaction hangup {};
  sigaction(SIGHUP, nullptr, &hangup);
  if (hangup.sa_handler != SIG_IGN) sigaddset(&signals_, SIGHUP);
  pthread_sigmask(SIG_BLOCK, &signals_, &mask_before_);
  sigemptyset(&new_map_signal_);
  sigaddset(&new_map_signal_, SIGUSR1);
  pthread_sigmask(SIG_BLOCK, &new_map_signal_, nullptr);
  // A reader of our words that has gone, or a file at its limit, is an error of that write and not the end of
  // a run.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
}

StopSignal::~StopSignal() {
  pthread_sigmask(SIG_SETMASK, &mask_before_, nullptr);
}

bool StopSignal::requested() {
  if (requested_) return true;
  const timespec no_wait{};
  if (sigtimedwait(&signals_, nullptr, &no_wait) < 0) return false;
  requested_ = true;
  // From here on a second signal has its default effect: an end at once, also out of a blocking call.
  pthread_sigmask(SIG_UNBLOCK, &signals_, nullptr);
  return true;
}

bool StopSignal::new_map_requested() {
  const timespec no_wait{};
  return sigtimedwait(&new_map_signal_, nullptr, &no_wait) > 0;
}

}  // namespace cairn
