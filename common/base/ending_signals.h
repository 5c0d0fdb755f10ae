// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <csignal>

namespace cairn {

/// SIGINT, SIGTERM and, without nohup, SIGHUP, blocked in this thread and in every one that it begins later:
/// for a program that waits for them itself (sigwait). Call it before any thread.
[[nodiscard]] sigset_t block_ending_signals();

}  // namespace cairn
