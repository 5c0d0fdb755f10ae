// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <string>

#include "common/base/time.h"
#include "common/wire/messages.h"

namespace cairn {

/// Sees to it that each request of a run of cairnctl is carried out once, and that few are under way at a
/// time, and of one operator fewer still: each holds what it brought and its place behind the store's writer.
/// The time is handed in. Pure; used from one thread.
class AdminGate {
 public:
  static constexpr size_t kMostRuns = 64;  ///< remembered; those with a request under way are never forgotten
  static constexpr size_t kMostInWork = 16;      ///< of all operators
  static constexpr size_t kMostInWorkOfOne = 4;  ///< an operator with many windows leaves room for others

  /// An operator of a secured site has one name, and may run cairnctl several times at once.
  struct Run {
    std::string operator_name;
    SessionId session;
    auto operator<=>(const Run&) const = default;
  };

  enum class Admission : uint8_t {
    kNew,       ///< to be carried out; exactly one answered() must follow
    kRepeated,  ///< answered already: last() should be written again
    kInWork,    ///< under way
    kRefused,   ///< not taken now; answered() with `why` must follow
  };
  struct Judgement {
    Admission admission = Admission::kNew;
    std::string why;  ///< of a refusal
  };
  [[nodiscard]] Judgement admit(const std::string& operator_name, wire::CommandId command, MonotonicTime now);
  void answered(const std::string& operator_name, wire::AdminReply reply, MonotonicTime now);
  /// The last answer to a run; null: there is none.
  [[nodiscard]] const wire::AdminReply* last(const Run& run) const;
  [[nodiscard]] bool knows(const Run& run) const { return runs_.contains(run); }

 private:
  struct Known {
    MonotonicTime last_heard;
    std::optional<wire::AdminReply> last = {};
    std::optional<wire::CommandId> in_work = {};  ///< cairnctl waits for an answer before it asks on
  };
  using Runs = std::map<Run, Known>;
  [[nodiscard]] size_t in_work() const;
  [[nodiscard]] size_t in_work_of(const std::string& operator_name) const;
  [[nodiscard]] std::string why_not(const std::string& operator_name, const Known& asking) const;
  void make_room();

  Runs runs_;
};

}  // namespace cairn
