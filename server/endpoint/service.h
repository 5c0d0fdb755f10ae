// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "common/base/log.h"
#include "common/base/result.h"
#include "common/map/snapshot.h"
#include "common/wire/participant.h"
#include "common/wire/refused_peers.h"
#include "server/service/service_options.h"

namespace cairn {

/// The map service of a DDS domain.
struct ServiceOptions : MapServiceOptions {
  int domain = 0;
  std::string listen;  ///< interface or address; empty: by profile
  std::string profile = "loopback";
  std::filesystem::path store;  ///< folder in which all is kept; empty: in memory only
  int workers = 2;              ///< of the urgent executor
  /// Security folder of a secured site, where nobody may do anything until its operators have said who may;
  /// empty: an open site, where everybody may write and make maps until they say otherwise.
  std::string security;
  std::shared_ptr<wire::RefusedPeers> refused = {};  ///< of a LogRedirect: for the audit log
  int loss_per_mille = 0;                            ///< outgoing packets dropped on purpose; for tests
};

/// A random ServerId and a start count from the wall clock, for servers without a store.
void name_this_start(ServiceOptions* options);

/// How a service with these options joins its domain.
[[nodiscard]] wire::ParticipantOptions joining_options(const ServiceOptions& options);

/// The map service of one DDS domain: from start() until destruction it serves, on threads of its own
/// (README.md). Thread-safe.
class Service {
 public:
  /// Starts the service. With a store, all its maps are there on return. Errors: kUsage (domain),
  /// kConfiguration (profile, interface), kRefused (the domain has a server on this host, the store has one),
  /// kIo (store).
  [[nodiscard]] static Result<std::unique_ptr<Service>> start(const ServiceOptions& options, Logger log);
  /// Calls close(), if that was not called, and leaves the domain.
  ~Service();
  Service(const Service&) = delete;
  Service& operator=(const Service&) = delete;

  /// Answers nothing more, ends running work as soon as possible and completes the store. The domain is left
  /// only by the destructor, so that nothing which the middleware does can cost anything.
  void close();

  /// This machine's end of the network path on which the service is reached.
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
