// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <map>
#include <string>
#include <vector>

#include "common/base/time.h"
#include "common/wire/rig_messages.h"
#include "server/service/operator_answer.h"

namespace cairn {

/// The rigs that say of themselves what they do, and what was ordered of each: who gave an order gives it to
/// the rig itself, which says so here, so that an emergency stop needs no server and is on record all the
/// same. Pure: states and times are handed in. Used from one thread.
class RigList {
 public:
  static constexpr std::chrono::seconds kSilent{3};      ///< then it is told to be silent
  static constexpr std::chrono::minutes kForgotten{10};  ///< then it is not told any more
  static constexpr size_t kMost = 64;                    ///< at a time; anybody may say to be a rig

  /// Takes a state of a rig. Returns lines for the record: orders, with who gave them and whether they were
  /// refused, emergency stops, and what keeps the rig from moving. None where nothing has changed.
  [[nodiscard]] std::vector<std::string> heard(const wire::RigState& state, MonotonicTime now);
  /// Returns lines for the record on rigs that have fallen silent, and forgets those silent for long.
  [[nodiscard]] std::vector<std::string> pass(MonotonicTime now);

  /// The rigs that were seen, by name, for an operator.
  [[nodiscard]] std::vector<told::RigSeen> seen(MonotonicTime now) const;

 private:
  struct Rig {
    wire::RigState state;
    MonotonicTime heard;
    bool silent = false;
  };
  std::map<std::string, Rig> rigs_;
};

}  // namespace cairn
