// SPDX-License-Identifier: Apache-2.0
#include "server/service/place_desk.h"

#include <utility>

namespace cairn {

void PlaceDesk::report(MapSnapshotPtr snapshot, std::vector<KeyframeView> views) {
  const std::scoped_lock lock(mutex_);
  const MapId map = snapshot->map;
  reported_.insert_or_assign(map, Reported{std::move(snapshot), std::move(views)});
  if (std::exchange(scheduled_, true)) return;
  workers_.submit([self = shared_from_this()] {
    {
      const std::scoped_lock taken(self->mutex_);
      self->scheduled_ = false;
    }
    self->catch_up();
  });
}

void PlaceDesk::remove(const MapId& map) {
  const std::scoped_lock one_at_a_time(catching_up_);
  const std::scoped_lock lock(mutex_);
  reported_.erase(map);
  auto next = std::make_shared<PlaceIndex>(*index_);
  next->remove(map);
  index_ = std::move(next);
}

void PlaceDesk::catch_up() {
  const std::scoped_lock one_at_a_time(catching_up_);
  std::map<MapId, Reported> waiting;
  {
    const std::scoped_lock lock(mutex_);
    waiting.swap(reported_);
  }
  for (auto& [map, reported] : waiting) {
    auto next = std::make_shared<PlaceIndex>(*index());
    next->put(index_map(next->find(map), std::move(reported.snapshot), reported.views));
    const std::scoped_lock lock(mutex_);
    index_ = std::move(next);
  }
}

std::shared_ptr<const PlaceIndex> PlaceDesk::index() const {
  const std::scoped_lock lock(mutex_);
  return index_;
}

void PlaceDesk::ask(PlaceQuery query, Done done) {
  auto shared = std::make_shared<const PlaceQuery>(std::move(query));
  workers_.submit([self = shared_from_this(), query = std::move(shared), done = std::move(done)] {
    if (query->lockstep) self->catch_up();
    done(relocalize(*self->index(), *query->camera, query->view, self->options_));
  });
}

}  // namespace cairn
