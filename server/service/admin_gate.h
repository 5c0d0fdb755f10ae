// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <string>

#include "common/base/time.h"
#include "common/wire/messages.h"

namespace cairn {

/// Sees to it that each request of an operator is carried out once (`name` is that of a run of cairnctl), and
/// that few are under way at a time: each holds what it brought and its place behind the store's writer. The
/// time is handed in. Pure; used from one thread.
class AdminGate {
 public:
  static constexpr size_t kMaxOperators =
      64;  ///< remembered; those with a request under way are never forgotten
  static constexpr size_t kMostInWork = 16;  ///< of all operators

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
  [[nodiscard]] Judgement admit(const std::string& name, wire::CommandId command, MonotonicTime now);
  void answered(const std::string& name, wire::AdminReply reply, MonotonicTime now);
  /// Null when there is none.
  [[nodiscard]] const wire::AdminReply* last(const std::string& name) const;
  [[nodiscard]] bool knows(const std::string& name) const { return operators_.contains(name); }

 private:
  struct Operator {
    MonotonicTime last_heard;
    std::optional<wire::AdminReply> last = {};
    std::optional<wire::CommandId> in_work = {};  ///< cairnctl waits for an answer before it asks on
  };
  [[nodiscard]] size_t in_work() const;
  void make_room();

  std::map<std::string, Operator> operators_;
};

}  // namespace cairn
