// SPDX-License-Identifier: Apache-2.0
#include "server/service/resume.h"
#include "server/service/switchboard.h"

/// What the store has kept, taken up at the start; and what it gets at the end.
namespace cairn {

void Switchboard::resume(std::vector<RestoredMap> restored) {
  resume_clients(restored);
  for (RestoredMap& map : restored) {
    const MapId id = map.header.id;
    const auto runner = make_runner(id);
    maps_.add(id, MapEntry{map.header.name, runner, {}, {}, map.plane_aligned});
    runner->resume(std::move(map));
  }
  run_posted();  // each map's first revision: whoever is heard first finds them listed
}

void Switchboard::resume_clients(const std::vector<RestoredMap>& restored) {
  std::vector<KeptDecisions> kept;
  for (const RestoredMap& map : restored) kept.push_back({map.header.id, map.header.epoch, map.decisions});
  for (auto& [name, resumed] : cairn::resume_clients(kept)) {
    Client& client = client_of(name);
    client.offer_gate.resume(resumed.session, std::move(resumed.offers));
    if (resumed.seed) {
      client.seed_gate.resume(*resumed.seed);
    } else {
      client.seed_gate.enter_session(resumed.session);
    }
  }
}

void Switchboard::save_last_changes() {
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.runner) entry.runner->save_last_changes();
  }
}

}  // namespace cairn
