// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_persistence.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <new>
#include <optional>
#include <utility>

namespace cairn {
namespace {

constexpr int kMostDoublings = 6;  ///< of the delay after a failure: two minutes

/// Of a map maker without images: for the index.
std::vector<KeyframeView> views_with_pictures(const MapMaker& maker, const std::vector<ImageRecord>& images) {
  std::vector<KeyframeView> views = maker.keyframe_views();
  for (KeyframeView& view : views) {
    const auto image = std::find_if(images.begin(), images.end(),
                                    [&](const ImageRecord& r) { return r.keyframe == view.id; });
    if (image == images.end()) continue;
    auto pyramid = std::make_shared<Pyramid>();
    pyramid->build(image->image->view());
    view.pyramid = std::move(pyramid);
  }
  return views;
}

}  // namespace

/// A restored map, or one that has to be set aside.
struct MapPersistence::Loaded {
  MapId map;
  std::string name;  ///< as far as it is known
  Result<RestoredMap> restored = fail(ErrorCode::kInternal, "not loaded");
  std::vector<std::string> damage;
};

Result<std::unique_ptr<MapPersistence>> MapPersistence::start(const std::filesystem::path& folder,
                                                              Runtime runtime, Logger log) {
  auto store = Store::open(folder, log);
  if (!store) return tl::unexpected(store.error());
  return std::unique_ptr<MapPersistence>(
      new MapPersistence(std::move(*store), std::move(runtime), std::move(log)));
}

MapPersistence::MapPersistence(std::unique_ptr<Store> store, Runtime runtime, Logger log)
    : store_(std::move(store)),
      folder_(store_->folder()),
      server_(store_->server()),
      start_count_(store_->start_count()),
      deleted_ids_(store_->deleted_ids()),
      overlaps_(store_->overlaps()),
      log_(std::move(log)),
      unloaded_(store_->unplaced()),
      clock_(std::move(runtime.clock)),
      writer_(std::move(runtime.writer)),
      beside_(std::make_shared<HeldLane>(std::move(runtime.beside))),
      examiner_(std::move(runtime.examiner)) {
  writer_->begin([this] { return work(); });
}

MapPersistence::~MapPersistence() {
  examiner_->stop();
  beside_->stop();
  writer_->finish();
}

MapPersistence::Loaded MapPersistence::load(MapId map, const MapMakerOptions& options,
                                            RestoredImages images) const {
  Result<StoredMap> stored = fail(ErrorCode::kInternal, "not loaded");
  try {
    stored = store_->load(map);
  } catch (const std::exception& problem) {  // memory
    stored = fail(ErrorCode::kInternal, std::string("cannot be loaded: ") + problem.what());
  }
  return make_ready(map, std::move(stored), options, images);
}

MapPersistence::Loaded MapPersistence::make_ready(MapId map, Result<StoredMap> stored,
                                                  const MapMakerOptions& options, RestoredImages images) {
  Loaded loaded{.map = map, .name = {}, .damage = {}};
  const auto fail_with = [&loaded](const Error& error) {
    loaded.restored = tl::unexpected(error);
    return std::move(loaded);
  };
  if (!stored) return fail_with(stored.error());
  try {
    loaded.damage = std::move(stored->damage);
    const MapHeader& header = stored->header;
    loaded.name = header.name;
    // Indexed first, and only then, if they are needed, made ready to be worked on: that takes several times
    // as long.
    auto made = MapMaker::restore(stored->record, {header.id, header.name, header.epoch}, options,
                                  RestoredImages::kLetGo);
    if (!made) return fail_with(made.error());
    loaded.damage.insert(loaded.damage.end(), made->repairs.begin(), made->repairs.end());
    MapMaker& maker = *made->maker;
    IndexedMapPtr indexed =
        index_map(nullptr, maker.snapshot(), views_with_pictures(maker, stored->record.images));
    if (images == RestoredImages::kStay || !loaded.damage.empty() || maker.has_work()) {
      for (const ImageRecord& r : stored->record.images)
        (void)maker.give_image_back(r.keyframe, r.image->view());
    }
    if (loaded.damage.empty()) (void)maker.take_changes();  // from here on, only what changes
    loaded.restored = RestoredMap{header,
                                  std::move(made->maker),
                                  stored->record.foundation->plane_aligned,
                                  std::move(stored->epochs),
                                  std::move(stored->decisions),
                                  std::move(stored->labels),
                                  std::move(stored->proposals),
                                  stored->last_proposal,
                                  std::move(stored->contributions),
                                  std::move(indexed)};
  } catch (const std::exception& problem) {  // memory, a library
    return fail_with({ErrorCode::kInternal, std::string("cannot be loaded: ") + problem.what()});
  }
  return loaded;
}

Result<RestoredMap> MapPersistence::settle(Loaded loaded) {
  const std::string name = to_hex(loaded.map.bytes);
  for (const std::string& line : loaded.damage) log_->error("map {}: {}", name, line);
  if (!loaded.restored) return std::move(loaded.restored);
  forget_unloaded(loaded.map);
  RestoredMap& map = *loaded.restored;
  if (!loaded.damage.empty()) {
    MapUpdate saved{map.maker->take_changes(), map.decisions, map.labels, {}, map.contributions};
    saved.last_proposal = map.last_proposal;
    map.proposals.clear();  // they stay in the damaged file
    const auto aside = store_->replace(map.header, saved, loaded.damage);
    log_->error("map {} ({}) goes on without what is damaged; {}", name, map.header.name,
                aside ? "the damaged file is kept as " + aside->string() : aside.error().message);
  }
  return std::move(loaded.restored);
}

void MapPersistence::part_with(const Loaded& failed) {
  const Error& error = failed.restored.error();
  if (error.code != ErrorCode::kDamaged) return leave_alone(failed.map, failed.name, error.message);
  std::vector<std::string> reasons = failed.damage;
  reasons.push_back(error.message);
  const auto aside = store_->set_aside(failed.map, failed.name, reasons);
  if (!aside) return leave_alone(failed.map, failed.name, error.message + "; " + aside.error().message);
  log_->error("map {} cannot be used: {}; kept as {}", to_hex(failed.map.bytes), error.message,
              aside->string());
}

std::vector<UnloadedMap> MapPersistence::unloaded() const {
  std::unique_lock lock(mutex_);
  std::vector<UnloadedMap> maps = unloaded_;
  lock.unlock();
  std::erase_if(maps, [](const UnloadedMap& map) {
    std::error_code ignored;  // a link into nowhere lies there, too
    return !std::filesystem::exists(std::filesystem::symlink_status(map.file, ignored));
  });
  return maps;
}

void MapPersistence::leave_alone(MapId map, const std::string& name, const std::string& reason) {
  log_->error("map {} is left alone: {}", to_hex(map.bytes), reason);
  forget_unloaded(map);
  const std::scoped_lock lock(mutex_);
  unloaded_.push_back({map, name, store_->path_of(map), reason});
}

void MapPersistence::forget_unloaded(MapId map) {
  const std::scoped_lock lock(mutex_);
  std::erase_if(unloaded_, [map](const UnloadedMap& other) { return other.map == map; });
}

std::vector<RestoredMap> MapPersistence::restore(const MapMakerOptions& options, const Parallel& parallel,
                                                 RestoredImages images) {
  const std::vector<MapId> maps = store_->maps();
  std::vector<Loaded> loaded(maps.size());
  std::atomic<size_t> next{0};
  parallel([&] {
    for (size_t i = next++; i < maps.size(); i = next++) loaded[i] = load(maps[i], options, images);
  });
  std::vector<RestoredMap> restored;
  for (Loaded& one : loaded) {
    if (!one.restored) part_with(one);
    if (auto map = settle(std::move(one))) restored.push_back(std::move(*map));
  }
  return restored;
}

void MapPersistence::restore_one(MapId map, const MapMakerOptions& options, RestoredImages images, Undo undo,
                                 std::function<void(Result<RestoredMap>)> done) {
  auto loaded = std::make_shared<Loaded>(load(map, options, images));
  run([this, loaded, undo, done = std::move(done)](Store&) {
    if (!loaded->restored) take_back(loaded->map, loaded->name, undo, loaded->restored.error().message);
    done(settle(std::move(*loaded)));
  });
}

void MapPersistence::change_state(MapId map, const MapMakerOptions& options, RestoredImages images,
                                  StateChange how) {
  run([this, map, options, images, how = std::move(how)](Store& writers) {
    writers.let_go(map);
    beside_->submit_within(how.place, [this, map, options, images, how] {
      Store& store = *store_;
      const AcceptState accept = [&](StoredMap state) -> Status {
        store.note_lost_proposals(map, state);
        Loaded loaded = make_ready(map, std::move(state), options, images);
        if (!loaded.damage.empty()) return fail(ErrorCode::kDamaged, loaded.damage.front());
        if (!loaded.restored) return tl::unexpected(loaded.restored.error());
        how.take(std::move(*loaded.restored));
        return {};
      };
      const Status changed = guarded([&] { return how.change(store, accept); });
      run([map, how, changed](Store& same) {
        same.let_go(map);
        how.done(changed);
      });
    });
  });
}

void MapPersistence::take_back(MapId map, const std::string& name, Undo undo, const std::string& reason) {
  log_->error("map {} cannot be served: {}", to_hex(map.bytes), reason);
  const Status undone = (store_.get()->*undo)(map);
  if (!undone) leave_alone(map, name, reason + "; " + undone.error().message);
}

void MapPersistence::read_images(MapId map, std::vector<KeyframeId> keyframes, ImagesRead done) {
  run([this, map, keyframes = std::move(keyframes), done = std::move(done)](Store& store) {
    Result<std::vector<ImageRow>> rows;
    const Status read =
        guarded([&] { return rows = store.read_images(map, keyframes, kReadPerTurn), Status(); });
    if (!read) rows = tl::unexpected(read.error());
    done(std::move(rows));
  });
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
  writer_->wake();
}

void MapPersistence::run_beside(std::function<void(Store& store)> task) {
  beside_->submit([this, task = std::move(task)] { task(*store_); });
}

void MapPersistence::hold_beside(std::function<void(HeldLane::Hold place)> then) {
  beside_->hold(std::move(then));
}

void MapPersistence::run_examination(std::function<void(const std::filesystem::path& folder)> task) {
  examiner_->submit([this, task = std::move(task)] { task(folder_); });
}

std::chrono::seconds MapPersistence::delay_after(int failures) {
  return kSaveDelay * (1 << std::min(failures, kMostDoublings));
}

void MapPersistence::later(std::function<void()> task, std::chrono::milliseconds delay) {
  {
    const std::scoped_lock lock(mutex_);
    const auto due = clock_->now() + delay;
    const auto after =
        std::find_if(later_.begin(), later_.end(), [&](const Later& l) { return l.due > due; });
    later_.insert(after, {due, std::move(task)});
  }
  writer_->wake();
}

std::string MapPersistence::trouble() const {
  const std::scoped_lock lock(mutex_);
  return trouble_;
}

std::optional<MonotonicTime> MapPersistence::work() {
  std::unique_lock lock(mutex_);
  std::vector<Job> jobs = std::exchange(jobs_, {});
  std::vector<Later> due;
  const MonotonicTime now = clock_->now();
  while (!later_.empty() && later_.front().due <= now) {
    due.push_back(std::move(later_.front()));
    later_.erase(later_.begin());
  }
  lock.unlock();
  for (const Later& task : due) (void)guarded([&] { return task.task(), Status(); });
  carry_out(std::move(jobs));
  probe_if_due();
  (void)guarded([&] { return store_->tidy(), Status(); });
  lock.lock();
  std::optional<MonotonicTime> next;
  if (!later_.empty()) next = later_.front().due;
  if (!trouble_.empty()) next = next ? std::min(*next, probe_due_) : probe_due_;
  return next;
}

void MapPersistence::carry_out(std::vector<Job> jobs) {
  std::vector<bool> taken(jobs.size());
  for (size_t i = 0; i < jobs.size(); ++i) {
    if (taken[i]) continue;
    if (jobs[i].task) {
      (void)guarded([&] { return jobs[i].task(*store_), Status(); });
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
  if (group.front()->creation) {
    const Job& first = *group.front();
    finish(first, guarded([&] { return store_->create(*first.creation, first.update); }));
    group.erase(group.begin());
    if (group.empty()) return;
  }
  const Status written = guarded([&] {
    std::vector<MapUpdate> updates;
    updates.reserve(group.size());
    for (Job* job : group) updates.push_back(std::move(job->update));
    return store_->write(group.front()->map, updates);
  });
  for (const Job* job : group) finish(*job, written);
}

void MapPersistence::finish(const Job& job, const Status& written) {
  note(written);
  if (job.done) {
    (void)guarded([&] { return job.done(written), Status(); });
  } else if (!written) {
    log_->error("map {}: {}", to_hex(job.map.bytes), written.error().message);
  }
}

Status MapPersistence::guarded(const std::function<Status()>& work) {
  try {
    return work();
  } catch (const std::bad_alloc&) {  // there may be some soon
    log_->error("no memory while keeping maps");
    return fail(ErrorCode::kIo, "no memory");
  } catch (const std::exception& problem) {
    log_->error("internal error while keeping maps: {}", problem.what());
    return fail(ErrorCode::kInternal, "internal error; the server's log says more");
  }
}

void MapPersistence::note(const Status& written) {
  if (!written && !sqlite::is_write_failure(written.error())) return;
  const std::scoped_lock lock(mutex_);
  const bool was_well = trouble_.empty();
  trouble_ = written ? std::string() : "nothing can be kept: " + written.error().message;
  probe_due_ = clock_->now() + kSaveDelay;
  if (!written && was_well) log_->error("{}", trouble_);
  if (written && !was_well) log_->info("the store can be written again");
}

void MapPersistence::probe_if_due() {
  {
    const std::scoped_lock lock(mutex_);
    if (trouble_.empty() || clock_->now() < probe_due_) return;
  }
  note(guarded([this] { return store_->probe(); }));
}

}  // namespace cairn
