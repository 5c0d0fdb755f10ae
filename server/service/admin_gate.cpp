// SPDX-License-Identifier: Apache-2.0
#include "server/service/admin_gate.h"

#include <algorithm>
#include <utility>

namespace cairn {

AdminGate::Judgement AdminGate::admit(const std::string& operator_name, wire::CommandId command,
                                      MonotonicTime now) {
  const Run run{operator_name, command.session};
  if (!runs_.contains(run)) make_room();
  Known& asking = runs_.try_emplace(run, Known{now}).first->second;
  if (asking.last && asking.last->command == command) return {Admission::kRepeated, {}};
  if (asking.in_work == command) return {Admission::kInWork, {}};
  // Answered before the last one: it was overtaken on its way, and nobody waits for it.
  if (asking.last && command.seq < asking.last->command.seq) return {Admission::kInWork, {}};
  asking.last_heard = now;
  if (std::string why = why_not(operator_name, asking); !why.empty())
    return {Admission::kRefused, std::move(why)};
  asking.in_work = command;
  return {};
}

std::string AdminGate::why_not(const std::string& operator_name, const Known& asking) const {
  if (asking.in_work) return "an earlier request of yours is under way; ask again when it has been answered";
  if (in_work_of(operator_name) >= kMostInWorkOfOne) {
    return std::to_string(kMostInWorkOfOne) + " requests of operator " + operator_name +
           " are under way, and the server takes no more of one operator at a time; ask again when one of "
           "them has been answered";
  }
  if (in_work() < kMostInWork) return {};
  return std::to_string(kMostInWork) +
         " requests of operators are under way, and the server takes no more at a "
         "time; try again in a while";
}

void AdminGate::answered(const std::string& operator_name, wire::AdminReply reply, MonotonicTime now) {
  const auto known = runs_.find({operator_name, reply.command.session});
  if (known == runs_.end()) return;
  if (known->second.in_work == reply.command) known->second.in_work.reset();
  known->second.last_heard = now;  // he may not have it yet, however long it took
  known->second.last = std::move(reply);
}

const wire::AdminReply* AdminGate::last(const Run& run) const {
  const auto known = runs_.find(run);
  return known == runs_.end() || !known->second.last ? nullptr : &*known->second.last;
}

size_t AdminGate::in_work() const {
  return static_cast<size_t>(
      std::ranges::count_if(runs_, [](const auto& known) { return known.second.in_work.has_value(); }));
}

size_t AdminGate::in_work_of(const std::string& operator_name) const {
  return static_cast<size_t>(std::ranges::count_if(runs_, [&](const auto& known) {
    return known.second.in_work && known.first.operator_name == operator_name;
  }));
}

/// A forgotten run that is still at work would have its request done twice. Who begins many runs has his own
/// forgotten first.
void AdminGate::make_room() {
  while (runs_.size() >= kMostRuns) {
    std::map<std::string, size_t> runs_of;
    for (const auto& [run, known] : runs_) ++runs_of[run.operator_name];
    auto idle = runs_.end();
    const auto is_before = [&](const Runs::iterator one, const Runs::iterator other) {
      const size_t runs_of_one = runs_of[one->first.operator_name];
      const size_t runs_of_other = runs_of[other->first.operator_name];
      if (runs_of_one != runs_of_other) return runs_of_one > runs_of_other;
      return one->second.last_heard < other->second.last_heard;
    };
    for (auto it = runs_.begin(); it != runs_.end(); ++it) {
      if (!it->second.in_work && (idle == runs_.end() || is_before(it, idle))) idle = it;
    }
    if (idle == runs_.end()) return;  // none: fewer are at work than are remembered
    runs_.erase(idle);
  }
}

}  // namespace cairn
