// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sqlite3.h>

namespace cairn::testing {

/// While it lives, SQLite has few bytes more than it has now: a row of kTooLarge bytes cannot be read, for
/// now, and all others can. So a table is there that cannot be read to its end, though nothing of it is
/// damaged.
class ShortMemory {
 public:
  static constexpr int kTooLarge = 20'000'000;  ///< [bytes]

  ShortMemory() { sqlite3_hard_heap_limit64(sqlite3_memory_used() + kTooLarge / 2); }
  ~ShortMemory() { sqlite3_hard_heap_limit64(0); }
  ShortMemory(const ShortMemory&) = delete;
  ShortMemory& operator=(const ShortMemory&) = delete;
};

}  // namespace cairn::testing
