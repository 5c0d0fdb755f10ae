// SPDX-License-Identifier: Apache-2.0
#include "server/service/admin_gate.h"

#include <algorithm>
#include <utility>

namespace cairn {

AdminGate::Judgement AdminGate::admit(const std::string& name, wire::CommandId command, MonotonicTime now) {
  if (!operators_.contains(name)) make_room();
  Operator& asking = operators_.try_emplace(name, Operator{now}).first->second;
  if (asking.last && asking.last->command == command) return {Admission::kRepeated, {}};
  if (asking.in_work == command) return {Admission::kInWork, {}};
  // Answered before the last one: it was overtaken on its way, and nobody waits for it.
  if (asking.last && asking.last->command.session == command.session &&
      command.seq < asking.last->command.seq)
    return {Admission::kInWork, {}};
  asking.last_heard = now;
  if (asking.in_work) {
    return {Admission::kRefused,
            "an earlier request of yours is under way; ask again when it has been answered"};
  }
  if (in_work() >= kMostInWork) {
    return {Admission::kRefused,
            std::to_string(kMostInWork) +
                " requests of operators are under way, and the server takes no more at a "
                "time; try again in a while"};
  }
  asking.in_work = command;
  return {};
}

void AdminGate::answered(const std::string& name, wire::AdminReply reply, MonotonicTime now) {
  const auto known = operators_.find(name);
  if (known == operators_.end()) return;
  if (known->second.in_work == reply.command) known->second.in_work.reset();
  known->second.last_heard = now;  // he may not have it yet, however long it took
  known->second.last = std::move(reply);
}

const wire::AdminReply* AdminGate::last(const std::string& name) const {
  const auto known = operators_.find(name);
  return known == operators_.end() || !known->second.last ? nullptr : &*known->second.last;
}

size_t AdminGate::in_work() const {
  return static_cast<size_t>(std::count_if(operators_.begin(), operators_.end(), [](const auto& known) {
    return known.second.in_work.has_value();
  }));
}

/// Each run of cairnctl has a name of its own. A forgotten one that is still at work would have it done
/// twice.
void AdminGate::make_room() {
  while (operators_.size() >= kMaxOperators) {
    auto idle = operators_.end();
    for (auto it = operators_.begin(); it != operators_.end(); ++it) {
      if (!it->second.in_work &&
          (idle == operators_.end() || it->second.last_heard < idle->second.last_heard))
        idle = it;
    }
    if (idle == operators_.end()) return;  // none: fewer are at work than are remembered
    operators_.erase(idle);
  }
}

}  // namespace cairn
