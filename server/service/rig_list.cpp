// SPDX-License-Identifier: Apache-2.0
#include "server/service/rig_list.h"

namespace cairn {
namespace {

/// "operator-7 ordered stop", with what became of it.
std::string words_of_order(const wire::RigState& state, const wire::CommandId& before) {
  std::string words = (state.ordered_by.empty() ? "somebody" : state.ordered_by) + " ordered " +
                      std::string(wire::name_of(state.ordered));
  if (!state.refusal.empty()) words += ", refused: " + state.refusal;
  // A state is the newest only: of two orders at once the first is not in any.
  if (before.session == state.order.session && state.order.seq > before.seq + 1)
    words +=
        " (orders before it were not heard here: " + std::to_string(state.order.seq - before.seq - 1) + ")";
  return words;
}

}  // namespace

std::vector<std::string> RigList::heard(const wire::RigState& state, MonotonicTime now) {
  const auto known = rigs_.find(state.rig);
  if (known == rigs_.end() && rigs_.size() >= kMost) return {};
  const bool is_new = known == rigs_.end();
  Rig& rig = rigs_[state.rig];
  std::vector<std::string> lines;
  const auto say = [&](const std::string& words) { lines.push_back("rig " + state.rig + ": " + words); };
  if (is_new || rig.silent) say("it is there");
  const bool has_order = state.order.session.value != 0;
  // A tracker says again each second what was refused.
  const bool is_repeated = state.order.session == rig.state.order.session &&
                           state.ordered == rig.state.ordered && state.refusal == rig.state.refusal;
  if (has_order && state.order != rig.state.order && !is_repeated)
    say(words_of_order(state, rig.state.order));
  if (state.stopped != rig.state.stopped)
    say(state.stopped ? "it is in emergency stop" : "its emergency stop is over");
  if (state.trouble != rig.state.trouble)
    say(state.trouble.empty() ? "nothing keeps it from moving any more" : state.trouble);
  rig = {state, now, false};
  return lines;
}

std::vector<std::string> RigList::pass(MonotonicTime now) {
  std::vector<std::string> lines;
  for (auto& [name, rig] : rigs_) {
    if (rig.silent || now - rig.heard <= kSilent) continue;
    rig.silent = true;
    lines.push_back("rig " + name + ": it is silent");
  }
  std::erase_if(rigs_, [now](const auto& item) { return now - item.second.heard > kForgotten; });
  return lines;
}

std::vector<told::RigSeen> RigList::seen(MonotonicTime now) const {
  std::vector<told::RigSeen> all;
  for (const auto& [name, rig] : rigs_)
    all.push_back({rig.state, now - rig.heard > kSilent, now - rig.heard});
  return all;
}

}  // namespace cairn
