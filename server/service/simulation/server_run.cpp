// SPDX-License-Identifier: Apache-2.0
#include "server/service/simulation/server_run.h"

#include <array>
#include <utility>

namespace cairn::simulation {

ServerRun::ServerRun(const Setup& setup)
    : clock_(setup.clock), random_(*setup.random), in_process_(setup.listener) {}

Result<std::unique_ptr<ServerRun>> ServerRun::start(const Setup& setup) {
  std::unique_ptr<ServerRun> run(new ServerRun(setup));
  if (Status opened = run->open(setup); !opened) return tl::unexpected(opened.error());
  return run;
}

Status ServerRun::open(const Setup& setup) {
  auto writer = std::make_unique<WriterTurns>();
  auto store_strand = std::make_unique<SimulatedExecutor>(1);
  auto examiner = std::make_unique<SimulatedExecutor>(1);
  writer_ = writer.get();
  store_strand_ = store_strand.get();
  examiner_ = examiner.get();
  auto store = MapPersistence::start(
      setup.folder, {clock_, std::move(writer), std::move(store_strand), std::move(examiner)}, setup.log);
  if (!store) return tl::unexpected(store.error());
  store_ = std::move(*store);
  MapServiceOptions options;
  options.entropy = [this] { return static_cast<uint32_t>(random_()); };
  options.server = store_->at_start().server;
  options.start_count = store_->at_start().start_count;
  options.idle_after = setup.idle_after;
  options.clock = clock_;
  if (setup.adjust) setup.adjust(options);
  std::vector<RestoredMap> restored = store_->opening().restore(
      options.opening(), [](const Task& share) { share(); }, restored_images(options.idle_after));
  auto site = SiteAccess::open(
      setup.folder, SiteKind::kOpen, [clock = clock_] { return clock->wall(); }, setup.log);
  if (!site) return tl::unexpected(site.error());
  site_ = std::move(*site);
  options.access = site_->policy();
  if (setup.opened) setup.opened(*site_);
  service_ = std::make_unique<MapService>(
      options, MapService::Executors{urgent_, background_, queries_, idle_, site_changes_}, store_.get(),
      *site_, in_process_, [this](Task task) { home_.submit(std::move(task)); }, setup.log);
  in_process_.serve(*service_);
  service_->resume(std::move(restored));
  return {};
}

ServerRun::~ServerRun() {
  if (store_ != nullptr) kill();
}

bool ServerRun::run_something() {
  std::array<SimulatedExecutor*, 8> executors{&home_, &urgent_,       &background_,  &queries_,
                                              &idle_, &site_changes_, store_strand_, examiner_};
  std::array<SimulatedExecutor*, 8> ready{};
  size_t count = 0;
  for (SimulatedExecutor* executor : executors) {
    const bool may_run = executor != store_strand_ || !store_strand_takes_long_;
    if (may_run && executor->has_task()) ready[count++] = executor;
  }
  const bool writer_is_due = writer_->is_due(clock_->now());
  if (count == 0 && !writer_is_due) return false;
  const size_t chosen = draw(random_, count + (writer_is_due ? 1 : 0));
  if (chosen == count) {
    writer_->take_turn();
  } else {
    ready[chosen]->run_one(random_);
  }
  return true;
}

void ServerRun::tick_if_due() {
  if (clock_->now() >= service_->next_tick()) service_->tick(clock_->now());
}

void ServerRun::drop_all() {
  home_.stop();
  service_->stop();
  for (SimulatedExecutor* executor : {&urgent_, &background_, &queries_, &idle_, &site_changes_})
    executor->stop();
}

void ServerRun::end() {
  drop_all();
  service_->save_last_changes();
  store_.reset();
}

void ServerRun::kill() {
  writer_->cut();
  if (service_ != nullptr) drop_all();
  store_.reset();
}

}  // namespace cairn::simulation
