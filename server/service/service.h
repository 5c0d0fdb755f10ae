// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "common/base/log.h"
#include "common/base/result.h"
#include "common/map/snapshot.h"
#include "common/wire/participant.h"
#include "server/access/access_policy.h"
#include "server/mapping/map_maker.h"
#include "server/relocalization/relocalizer.h"
#include "server/service/wearer_rule.h"
#include "server/service/work_times.h"

namespace cairn {

struct ServiceOptions {
  int domain = 0;
  std::string listen;  ///< interface or address; empty: by profile
  std::string profile = "loopback";
  uint64_t seed = 0;            ///< of map ids; 0: random
  std::filesystem::path store;  ///< folder in which all is kept; empty: in memory only
  ServerId server;              ///< without a store: new with every start
  uint64_t start_count = 1;     ///< without a store: larger with every start, the epoch of its maps
  int workers = 2;              ///< of the urgent lane
  size_t max_maps = 1000;
  size_t max_memory_bytes = std::numeric_limits<size_t>::max();  ///< of all maps; beyond, none grows
  /// With a store: the images of a map that nobody has offered anything to for so long, and that has nothing
  /// to do, are let go until it has again; 0: never.
  std::chrono::seconds rest_after{60};
  /// A map that its maker lost at once (YoungMaps) is deleted when that has been elsewhere for so long; 0:
  /// never. What is made in lockstep stays, since a replay does not go by this clock.
  std::chrono::seconds drop_after{0};
  bool lockstep = true;  ///< whether clients may ask for it; who does is not served otherwise
  MapMakerOptions mapping;
  RelocOptions relocalization;
  WearerOptions wearers;
  std::shared_ptr<const AccessPolicy> access = {};  ///< nothing: the rights of the site
  bool is_open_site = true;  ///< until its operators decide otherwise, everybody may write and make maps
  WorkTimes* work_times = nullptr;  ///< where the map makers' work is counted; outlives the service
  int loss_per_mille = 0;           ///< outgoing packets dropped on purpose; for tests
};

/// A random ServerId and a start count from the wall clock, for servers without a store.
void name_this_start(ServiceOptions* options);

/// How a service with these options joins its domain.
[[nodiscard]] wire::ParticipantOptions joining_options(const ServiceOptions& options);

/// The map service of one DDS domain: from start() until destruction it serves, on threads of its own
/// (README.md). Thread-safe.
class Service {
 public:
  /// With a store, all its maps are there on return. Errors: kUsage (domain), kConfiguration (profile,
  /// interface), kRefused (the domain has a server on this host, the store has one), kIo (store).
  [[nodiscard]] static Result<std::unique_ptr<Service>> start(const ServiceOptions& options, Logger log);
  /// As close(), if that was not called, and leaves the domain.
  ~Service();
  Service(const Service&) = delete;
  Service& operator=(const Service&) = delete;

  /// Answers nothing more, ends running work as soon as possible and completes the store. The domain is left
  /// only by the destructor, so that nothing which the middleware does can cost anything.
  void close();

  /// Where it is reached: this machine's end.
  [[nodiscard]] const wire::NetworkPath& network() const;

  /// Serves a map that is made elsewhere: `snapshot` is its newest revision. It takes no keyframes.
  void publish(MapSnapshotPtr snapshot);
  /// The newest revision of each map, by id.
  [[nodiscard]] std::vector<MapSnapshotPtr> maps() const;

 private:
  struct State;
  explicit Service(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace cairn
