// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/service.h"

#include <malloc.h>

#include <algorithm>
#include <chrono>
#include <future>
#include <random>
#include <utility>

#include "common/base/utc.h"
#include "common/wire/participant.h"
#include "common/wire/security.h"
#include "server/endpoint/endpoint.h"
#include "server/keys/site_keys.h"
#include "server/service/map_persistence.h"
#include "server/service/site_access.h"
#include "server/service/store_threads.h"
#include "server/service/system_clock.h"
#include "server/service/worker_pool.h"

namespace cairn {
namespace {

constexpr int kBackgroundNice = 10;
constexpr int kIdleNice = 19;

struct KeysOfSite {
  SiteKeys clients;
  std::string authority;  ///< empty: an open site has none
};

/// Reads the keys of a secured site; none of an open one. Done before maps are read, which takes time.
Result<KeysOfSite> read_keys(const ServiceOptions& options, const Logger& log) {
  if (options.security.empty()) return KeysOfSite{};
  if (const auto name = wire::secured_name(options.security, "server", ""); !name)
    return tl::unexpected(name.error());
  const auto keys = wire::read_security(options.security);
  if (!keys) return tl::unexpected(keys.error());
  log->info("a secured site: the keys of server {} are good until {}", keys->name, to_utc(keys->expires));
  auto clients = SiteKeys::read(options.security);
  if (!clients) return tl::unexpected(clients.error());
  return KeysOfSite{*std::move(clients), keys->authority};
}

/// Once all else of the start is done: of a start that fails nobody reads what it says, and it is said once.
/// What cannot be known or kept is logged, and asked again at the next start.
void look_whose_store_it_is(Executor& site_changes, SiteAccess* site, const std::string& authority,
                            const Logger& log) {
  if (authority.empty()) return;
  std::promise<Status> looked;
  site_changes.submit([&] { looked.set_value(site->know_authority(authority)); }, Urgency::kUrgent);
  if (const Status known = looked.get_future().get(); !known)
    log->error("whose keys the store was served with last is not known: {}", known.error().message);
}

}  // namespace

void name_this_start(ServiceOptions* options) {
  std::random_device device;
  for (uint8_t& byte : options->server.bytes) byte = static_cast<uint8_t>(device());
  const auto since_epoch = std::chrono::system_clock::now().time_since_epoch();
  options->start_count =
      static_cast<uint64_t>(std::chrono::duration_cast<std::chrono::milliseconds>(since_epoch).count());
}

wire::ParticipantOptions joining_options(const ServiceOptions& options) {
  wire::ParticipantOptions joining;
  joining.domain = static_cast<uint32_t>(options.domain);
  joining.role = wire::Role::kServer;
  joining.listen = options.listen;
  joining.profile = options.profile;
  joining.security = options.security;
  joining.loss_per_mille = options.loss_per_mille;
  return joining;
}

/// close(), in order: the endpoint takes nothing more, all executors end (running work may still call it and
/// the other executors), the last changes go to the store, whose writer ends (its callbacks may call all of
/// them), then all go.
struct Service::State {
  State(int workers, const Logger& log)
      : urgent(workers, 0, log),
        background(1, kBackgroundNice, log),
        queries(std::max(1, workers / 2), 0, log),
        idle(1, kIdleNice, log),
        site_changes(1, 0, log) {}
  ~State() { close(); }
  void close() {
    if (endpoint) endpoint->stop();
    urgent.stop();
    background.stop();
    queries.stop();
    idle.stop();
    site_changes.finish();  // what operators did is on record
    if (endpoint && store) endpoint->save_last_changes();
    store.reset();
  }
  std::unique_ptr<SiteAccess> site;  ///< outlives who uses it
  std::unique_ptr<MapPersistence> store;
  std::unique_ptr<Endpoint> endpoint;
  WorkerPool urgent;
  WorkerPool background;
  WorkerPool queries;
  WorkerPool idle;
  WorkerPool site_changes;  ///< of `site`: no archive, backup or adjustment holds them up
};

Service::Service(std::unique_ptr<State> state) : state_(std::move(state)) {}
Service::~Service() = default;

Result<std::unique_ptr<Service>> Service::start(const ServiceOptions& options, Logger log) {
  if (options.domain < 0 || options.domain > static_cast<int>(wire::kMaxDomain)) {
    return fail(ErrorCode::kUsage, "domain " + std::to_string(options.domain) + ": expected 0 to 230");
  }
  auto keys = read_keys(options, log);
  if (!keys) return fail(keys.error().code, "--security " + keys.error().message);
  auto state = std::make_unique<State>(options.workers, log);
  ServiceOptions known = options;
  if (known.clock == nullptr) known.clock = std::make_shared<SystemClock>();
  if (!known.entropy)
    known.entropy = [device = std::make_shared<std::random_device>()] { return (*device)(); };
  std::vector<RestoredMap> restored;
  if (!options.store.empty()) {
    auto store = MapPersistence::start(options.store, store_threads(log), log);
    if (!store) return tl::unexpected(store.error());
    state->store = std::move(*store);
    known.server = state->store->at_start().server;
    known.start_count = state->store->at_start().start_count;
  }
  const SiteKind kind = options.security.empty() ? SiteKind::kOpen : SiteKind::kSecured;
  const auto wall = [clock = known.clock] { return clock->wall(); };
  auto site = SiteAccess::open(options.store, kind, wall, log);
  if (!site) return tl::unexpected(site.error());
  state->site = std::move(*site);
  if (known.access == nullptr) known.access = state->site->policy();
  if (state->store) {
    restored =
        state->store->opening().restore({options.mapping, options.relocalization.confirm.gravity},
                                        on_threads(options.workers), restored_images(options.idle_after));
    malloc_trim(0);  // what reading took; nobody is served yet
    log->info("{} maps from {}", restored.size(), options.store.string());
  }
  const MapService::Executors executors{state->urgent, state->background, state->queries, state->idle,
                                        state->site_changes};
  auto endpoint = Endpoint::start(known, executors, state->store.get(), *state->site,
                                  std::move(keys->clients), std::move(restored), log);
  if (!endpoint) return tl::unexpected(endpoint.error());
  state->endpoint = std::move(*endpoint);
  look_whose_store_it_is(state->site_changes, state->site.get(), keys->authority, log);
  return std::unique_ptr<Service>(new Service(std::move(state)));
}

void Service::close() {
  state_->close();
}

const wire::NetworkPath& Service::network() const {
  return state_->endpoint->network();
}

void Service::publish(MapSnapshotPtr snapshot) {
  state_->endpoint->publish(std::move(snapshot));
}

std::vector<MapSnapshotPtr> Service::maps() const {
  return state_->endpoint->maps();
}

}  // namespace cairn
