// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "common/base/log.h"
#include "server/service/executor.h"
#include "server/service/map_persistence.h"
#include "server/service/service_options.h"
#include "server/service/service_output.h"
#include "server/service/site_access.h"

namespace cairn {

/// Executors of the map service's work (README.md, Threads).
struct ServiceExecutors {
  Executor& urgent;
  Executor& background;
  Executor& queries;
  Executor& idle;
  Executor& site;  ///< one task at a time
};

/// Runs a task on the service's thread, soon; thread-safe.
using Post = std::function<void(Task task)>;

/// What all components of the map service work with. It keeps nothing of any subject: that is with the
/// component whose subject it is.
struct ServiceContext {
  MapServiceOptions options;
  ServiceExecutors executors;
  MapPersistence* store;  ///< null: nothing is kept
  SiteAccess& site;
  ServiceOutput& output;
  Post post;
  Logger log;

  [[nodiscard]] MonotonicTime now() const { return options.clock->now(); }
  [[nodiscard]] Timestamp wall() const { return options.clock->wall(); }
  [[nodiscard]] const AccessPolicy& access() const { return *options.access; }
};

}  // namespace cairn
