// SPDX-License-Identifier: Apache-2.0
#include "server/service/place_desk.h"

#include <exception>
#include <utility>

namespace cairn {

void PlaceDesk::report(MapSnapshotPtr snapshot, std::vector<KeyframeView> views) {
  const MapId map = snapshot->map;
  note(map, Reported{std::move(snapshot), std::move(views)});
}

void PlaceDesk::remove(const MapId& map) {
  note(map, Reported{});
}

void PlaceDesk::note(const MapId& map, Reported reported) {
  const std::scoped_lock lock(mutex_);
  reported_.insert_or_assign(map, std::move(reported));
  if (std::exchange(scheduled_, true)) return;
  indexers_.submit([self = shared_from_this()] {
    {
      const std::scoped_lock taken(self->mutex_);
      self->scheduled_ = false;
    }
    self->catch_up();
  });
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
    if (reported.snapshot == nullptr) {
      next->remove(map);
    } else {
      next->put(index_map(next->find(map), std::move(reported.snapshot), reported.views));
    }
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
  answerers_.submit([self = shared_from_this(), query = std::move(shared), done = std::move(done)] {
    PlaceAnswer answer{PlaceVerdict::kNotKnown, {}, "internal error; the server's log says more"};
    try {
      if (query->lockstep) self->catch_up();
      answer = relocalize(*self->index(), *query->camera, query->view, self->options_, query->scope);
    } catch (const std::exception& problem) {  // memory, a library: who has asked may ask again
      self->log_->error("internal error in a question: {}", problem.what());
    }
    done(std::move(answer));
  });
}

}  // namespace cairn
