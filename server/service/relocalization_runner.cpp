// SPDX-License-Identifier: Apache-2.0
#include "server/service/relocalization_runner.h"

#include <exception>
#include <utility>

namespace cairn {

void RelocalizationRunner::report(MapSnapshotPtr snapshot, std::vector<KeyframeView> views,
                                  IndexedMapPtr indexed, std::vector<MonotonicTime> offered) {
  const MapId map = snapshot->map;
  note(map, Reported{std::move(snapshot), std::move(views), std::move(indexed), std::move(offered)});
}

void RelocalizationRunner::remove(const MapId& map) {
  note(map, Reported{});
}

void RelocalizationRunner::note(const MapId& map, Reported reported) {
  const std::scoped_lock lock(mutex_);
  Reported& newest = reported_[map];
  if (reported.snapshot != nullptr && reported.indexed == nullptr)
    reported.indexed = std::move(newest.indexed);
  reported.offered.insert(reported.offered.begin(), newest.offered.begin(), newest.offered.end());
  newest = std::move(reported);
  if (std::exchange(scheduled_, true)) return;
  executors_.indexers.submit([self = shared_from_this()] {
    {
      const std::scoped_lock taken(self->mutex_);
      self->scheduled_ = false;
    }
    self->catch_up();
  });
}

void RelocalizationRunner::catch_up() {
  const std::scoped_lock one_at_a_time(changing_);
  std::map<MapId, Reported> waiting;
  {
    const std::scoped_lock lock(mutex_);
    waiting.swap(reported_);
  }
  for (auto& [map, reported] : waiting) {
    try {
      adopt(map, reported);
    } catch (const std::exception& problem) {
      // Memory. Of an idle map nothing else brings its images again.
      log_->error("map {}: not searched as it is now: {}; tried again with the next change",
                  reported.snapshot ? reported.snapshot->name : to_hex(map.bytes), problem.what());
      const std::scoped_lock lock(mutex_);
      const auto [newest, is_ours] = reported_.try_emplace(map, reported);
      if (!is_ours && newest->second.snapshot && !newest->second.indexed)
        newest->second.indexed = std::move(reported.indexed);
    }
  }
  plant_if_needed();
}

void RelocalizationRunner::adopt(const MapId& map, const Reported& reported) {
  PlaceIndex next = *index();
  if (reported.snapshot == nullptr) {
    next.remove(map);
    publish(std::move(next));
    if (listener_.removed) listener_.removed(map);
    return;
  }
  const IndexedMap* known = reported.indexed ? reported.indexed.get() : next.find(map);
  const IndexedMapPtr indexed = index_map(known, reported.snapshot, reported.views, options_.confirm.gravity);
  next.put(indexed);
  publish(std::move(next));
  if (times_ != nullptr) {
    for (const MonotonicTime arrival : reported.offered) times_->searchable(clock_->now() - arrival);
  }
  try {
    if (listener_.searched) listener_.searched(indexed, reported.views);
  } catch (const std::exception& problem) {  // memory: the map is searched all the same
    log_->error("internal error after map {} was indexed: {}", reported.snapshot->name, problem.what());
  }
}

void RelocalizationRunner::plant_if_needed() {
  if (planting_ || !index()->needs_planting(options_.most_scanned)) return;
  planting_ = true;
  executors_.planters.submit([self = shared_from_this()] { self->plant(); });
}

void RelocalizationRunner::plant() {
  std::optional<ImageForestPtr> forest;
  try {
    forest = plant_forest(*index(), options_.most_scanned, options_.forest);
  } catch (const std::exception& problem) {  // memory: the scan goes on, and the next change tries again
    log_->error("no forest of the images: {}", problem.what());
  }
  // Not here: what waits for the index must not wait for a thread that stands back for all others.
  executors_.indexers.submit(
      [self = shared_from_this(), forest = std::move(forest)] { self->adopt(forest); });
}

void RelocalizationRunner::adopt(std::optional<ImageForestPtr> forest) {
  const std::scoped_lock one_at_a_time(changing_);
  planting_ = false;
  if (!forest) return;
  PlaceIndex next = *index();
  next.set_forest(*std::move(forest));
  publish(std::move(next));
  plant_if_needed();  // what came meanwhile
}

void RelocalizationRunner::publish(PlaceIndex next) {
  auto shared = std::make_shared<const PlaceIndex>(std::move(next));
  const std::scoped_lock lock(mutex_);
  index_.swap(shared);
}

std::shared_ptr<const PlaceIndex> RelocalizationRunner::index() const {
  const std::scoped_lock lock(mutex_);
  return index_;
}

void RelocalizationRunner::ask(RelocalizationQuery query, Done done) {
  auto shared = std::make_shared<const RelocalizationQuery>(std::move(query));
  executors_.answerers.submit([self = shared_from_this(), query = std::move(shared), done = std::move(done)] {
    RelocalizationAnswer answer{
        RelocalizationVerdict::kNotThere, {}, "internal error; the server's log says more"};
    try {
      RelocOptions options = self->options_;
      if (query->lockstep) {
        self->catch_up();
        options.search = ImageSearch::kScan;
      }
      answer = relocalize(*self->index(), *query->camera, query->view, options, query->scope);
    } catch (const std::exception& problem) {  // memory, a library: who has asked may ask again
      self->log_->error("internal error in a query: {}", problem.what());
    }
    done(std::move(answer));
  });
}

}  // namespace cairn
