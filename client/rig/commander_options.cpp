// SPDX-License-Identifier: Apache-2.0
#include "client/rig/commander_options.h"

#include "common/base/member_count.h"

namespace cairn {

OptionList list_options(CommanderOptions* o) {
  constexpr OptionList::Range kMilliseconds = {0, 60'000};
  OptionList list(member_count<CommanderOptions>());
  list.add("search_after", &o->search_after, kMilliseconds, "ms");
  list.add("candidate_time", &o->candidate_time, kMilliseconds, "ms");
  list.add("kept", &o->kept, kMilliseconds, "ms");
  list.add("near", &o->near, kMilliseconds, "ms");
  list.add_order("near", "kept");
  list.add("anew", &o->anew, kMilliseconds, "ms");
  list.add("gone", &o->gone, kMilliseconds, "ms");
  list.add("missed_states", &o->missed_states, {1, 1000}, "states");
  list.add("longest_gap", &o->longest_gap, kMilliseconds, "ms");
  list.add("turned", &o->turned, kMilliseconds, "ms");
  return list;
}

}  // namespace cairn
