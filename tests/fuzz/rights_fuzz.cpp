// SPDX-License-Identifier: Apache-2.0
#include "server/access/rights_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace cairn::fuzz {

void decode(Bytes bytes) {
  const auto rights = read_rights(text_of(bytes));
  if (!rights) return;
  const auto again = read_rights(to_text(*rights));
  demand(again && again->table() == rights->table(), "rights that are read are written and read back");
}

std::vector<Input> seeds() {
  constexpr Timestamp kNow{1'800'000'000'000'000'000};
  MapId map;
  map.bytes.fill(0x3e);
  Rights rights(Right::kRead, true);
  const Subject group{Subject::Kind::kGroup, "crew"};
  bool is_sound = rights.put_group("crew", {"ann", "bob"}).has_value();
  is_sound = is_sound && rights.grant({group, map, Right::kWrite, Sphere{{1, 2, 3}, 4}, kNow, "ops", kNow});
  is_sound = is_sound && rights.grant({{}, map, Right::kAdd, Box{{0, 0, 0}, {1, 1, 1}}, {}, "ops", kNow});
  is_sound = is_sound && rights.let_create(group, false);
  is_sound = is_sound && rights.freeze(map, Closure{"ops", kNow, "an exhibition"});
  is_sound = is_sound && rights.block("eve", Closure{"ops", kNow, ""});
  demand(is_sound, "the seed's rights can be");
  return {copy_of(to_text(rights)), copy_of(to_text(Rights(Right::kNone, false)))};
}

}  // namespace cairn::fuzz
