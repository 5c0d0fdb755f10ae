// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_persistence.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <utility>

namespace cairn {
namespace {

/// A restored map, or one that has to be set aside.
struct Loaded {
  MapId map;
  Result<RestoredMap> restored = fail(ErrorCode::kInternal, "not loaded");
  std::vector<std::string> damage;
  std::vector<LabelRecord> labels;
};

Loaded load(const Store& store, MapId map, const MapMakerOptions& options) {
  Loaded loaded{.map = map, .damage = {}, .labels = {}};
  Result<StoredMap> stored = store.load(map);
  if (!stored) {
    loaded.restored = tl::unexpected(stored.error());
    return loaded;
  }
  loaded.damage = std::move(stored->damage);
  const MapHeader& header = stored->header;
  auto made = MapMaker::restore(stored->record, {header.id, header.name, header.epoch}, options);
  if (!made) {
    loaded.restored = tl::unexpected(made.error());
    return loaded;
  }
  loaded.damage.insert(loaded.damage.end(), made->repairs.begin(), made->repairs.end());
  loaded.labels = std::move(stored->labels);
  loaded.restored = RestoredMap{header, std::move(made->maker), stored->record.foundation->plane_aligned,
                                std::move(stored->epochs), std::move(stored->decisions)};
  return loaded;
}

}  // namespace

Result<std::unique_ptr<MapPersistence>> MapPersistence::start(const std::filesystem::path& folder,
                                                              Logger log) {
  auto store = Store::open(folder, log);
  if (!store) return tl::unexpected(store.error());
  return std::unique_ptr<MapPersistence>(new MapPersistence(std::move(*store), std::move(log)));
}

MapPersistence::MapPersistence(std::unique_ptr<Store> store, Logger log)
    : store_(std::move(store)),
      folder_(store_->folder()),
      server_(store_->server()),
      start_count_(store_->start_count()),
      log_(std::move(log)),
      thread_([this] { work(); }) {}

MapPersistence::~MapPersistence() {
  {
    const std::scoped_lock lock(mutex_);
    stopping_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

std::vector<RestoredMap> MapPersistence::restore(const MapMakerOptions& options, int threads) {
  const std::vector<MapId> maps = store_->maps();
  std::vector<Loaded> loaded(maps.size());
  std::atomic<size_t> next{0};
  const auto load_some = [&] {
    for (size_t i = next++; i < maps.size(); i = next++) {
      try {
        loaded[i] = load(*store_, maps[i], options);
      } catch (const std::exception& problem) {
        loaded[i].map = maps[i];
        loaded[i].restored = fail(ErrorCode::kInternal, std::string("cannot be loaded: ") + problem.what());
      }
    }
  };
  std::vector<std::thread> helpers;
  for (int i = 1; i < threads; ++i) helpers.emplace_back(load_some);
  load_some();
  for (std::thread& helper : helpers) helper.join();

  std::vector<RestoredMap> restored;
  for (Loaded& l : loaded) {
    const std::string name = to_hex(l.map.bytes);
    if (!l.restored && l.restored.error().code == ErrorCode::kNotFound) continue;  // never made
    if (!l.restored && l.restored.error().code != ErrorCode::kDamaged) {
      log_->error("map {} is left alone: {}", name, l.restored.error().message);
      continue;
    }
    for (const std::string& line : l.damage) log_->error("map {}: {}", name, line);
    if (!l.restored) {
      l.damage.push_back(l.restored.error().message);
      const auto aside = store_->set_aside(l.map, l.damage);
      log_->error("map {} cannot be used: {}; {}", name, l.restored.error().message,
                  aside ? "kept as " + aside->string() : aside.error().message);
      continue;
    }
    if (!l.damage.empty()) {
      MapUpdate saved{l.restored->maker->take_changes(), l.restored->decisions, l.labels, {}};
      const auto aside = store_->replace(l.restored->header, saved, l.damage);
      log_->error("map {} ({}) goes on without what is damaged; {}", name, l.restored->header.name,
                  aside ? "the damaged file is kept as " + aside->string() : aside.error().message);
    } else {
      (void)l.restored->maker->take_changes();  // the store has them
    }
    restored.push_back(std::move(*l.restored));
  }
  return restored;
}

void MapPersistence::create(MapHeader header, MapUpdate whole, Done done) {
  const MapId map = header.id;
  post({{}, map, std::move(header), std::move(whole), std::move(done)});
}

void MapPersistence::write(MapId map, MapUpdate update, Done done) {
  post({{}, map, {}, std::move(update), std::move(done)});
}

void MapPersistence::run(std::function<void(Store& store)> task) {
  post({std::move(task), {}, {}, {}, {}});
}

void MapPersistence::post(Job job) {
  {
    const std::scoped_lock lock(mutex_);
    jobs_.push_back(std::move(job));
  }
  wake_.notify_one();
}

void MapPersistence::later(std::function<void()> task) {
  {
    const std::scoped_lock lock(mutex_);
    later_.push_back({Clock::now() + kSaveDelay, std::move(task)});
  }
  wake_.notify_one();
}

std::string MapPersistence::trouble() const {
  const std::scoped_lock lock(mutex_);
  // After a while the next update is the one that finds out.
  return Clock::now() - trouble_since_ < 2 * kSaveDelay ? trouble_ : std::string();
}

void MapPersistence::work() {
  std::unique_lock lock(mutex_);
  while (true) {
    const auto has_work = [this] { return stopping_ || !jobs_.empty(); };
    if (later_.empty()) {
      wake_.wait(lock, [&] { return has_work() || !later_.empty(); });
    } else {
      wake_.wait_until(lock, later_.front().due, has_work);
    }
    std::vector<Job> jobs = std::exchange(jobs_, {});
    if (jobs.empty() && stopping_) return;
    std::vector<Later> due;
    const auto now = Clock::now();
    while (!later_.empty() && later_.front().due <= now) {
      due.push_back(std::move(later_.front()));
      later_.erase(later_.begin());
    }
    lock.unlock();
    try {
      for (const Later& task : due) task.task();
      carry_out(std::move(jobs));
      store_->tidy();
    } catch (const std::exception& problem) {
      log_->error("internal error while keeping maps: {}", problem.what());
    }
    lock.lock();
  }
}

void MapPersistence::carry_out(std::vector<Job> jobs) {
  std::vector<bool> taken(jobs.size());
  for (size_t i = 0; i < jobs.size(); ++i) {
    if (taken[i]) continue;
    if (jobs[i].task) {
      jobs[i].task(*store_);
      continue;
    }
    // All that this batch has of the map, up to a task, which keeps its place.
    std::vector<Job*> group;
    for (size_t j = i; j < jobs.size() && !jobs[j].task; ++j) {
      if (jobs[j].map != jobs[i].map) continue;
      taken[j] = true;
      group.push_back(&jobs[j]);
    }
    write_group(std::move(group));
  }
}

void MapPersistence::write_group(std::vector<Job*> group) {
  Status written;
  if (group.front()->creation) {
    Job& first = *group.front();
    written = store_->create(*first.creation, first.update);
    note(written);
    if (first.done) first.done(written);
    group.erase(group.begin());
    if (group.empty()) return;
  }
  std::vector<MapUpdate> updates;
  for (Job* job : group) updates.push_back(std::move(job->update));
  written = store_->write(group.front()->map, updates);
  note(written);
  for (const Job* job : group) {
    if (job->done) job->done(written);
  }
}

void MapPersistence::note(const Status& written) {
  const std::scoped_lock lock(mutex_);
  const bool was_well = trouble_.empty();
  trouble_ = written ? std::string() : "nothing can be kept: " + written.error().message;
  trouble_since_ = Clock::now();
  if (!written && was_well) log_->error("{}", trouble_);
  if (written && !was_well) log_->info("the store can be written again");
}

}  // namespace cairn
