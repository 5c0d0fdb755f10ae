// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_persistence.h"

#include <algorithm>
#include <optional>
#include <utility>

namespace cairn {
namespace {

constexpr int kMostDoublings = 6;  ///< of the delay after a failure: two minutes

}  // namespace

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
      at_start_{store_->server(), store_->start_count(), store_->deleted_ids(), store_->overlaps()},
      log_(std::move(log)),
      clock_(std::move(runtime.clock)),
      writer_(std::move(runtime.writer)),
      strand_(std::make_shared<HeldStrand>(std::move(runtime.strand))),
      examiner_(std::move(runtime.examiner)),
      opening_({*store_, [this](std::function<void(Store&)> task) { run(std::move(task)); }, strand_, log_}) {
  writer_->begin([this] { return work(); });
}

MapPersistence::~MapPersistence() {
  examiner_->stop();
  strand_->stop();
  writer_->finish();
}

void MapPersistence::read_images(MapId map, std::vector<KeyframeId> keyframes, ImagesRead done) {
  run([this, map, keyframes = std::move(keyframes), done = std::move(done)](Store& store) {
    Result<std::vector<ImageRow>> rows;
    const Status read =
        guarded(log_, [&] { return rows = store.read_images(map, keyframes, kReadPerTurn), Status(); });
    if (!read) rows = tl::unexpected(read.error());
    done(std::move(rows));
  });
}

void MapPersistence::create(MapHeader header, MapUpdate whole, Done done) {
  const MapId map = header.id;
  post({.map = map, .creation = std::move(header), .update = std::move(whole), .done = std::move(done)});
}

void MapPersistence::write(MapId map, MapUpdate update, Done done) {
  post({.map = map, .update = std::move(update), .done = std::move(done)});
}

void MapPersistence::run(std::function<void(Store& store)> task) {
  post({.task = std::move(task)});
}

void MapPersistence::post(Job job) {
  {
    const std::scoped_lock lock(mutex_);
    jobs_.push_back(std::move(job));
  }
  writer_->wake();
}

void MapPersistence::run_on_strand(std::function<void(Store& store)> task) {
  strand_->submit([this, task = std::move(task)] { task(*store_); });
}

void MapPersistence::hold_strand(std::function<void(HeldStrand::Hold place)> then) {
  strand_->hold(std::move(then));
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
  carry_out();  // what a turn that failed has left
  {
    const std::scoped_lock lock(mutex_);
    batch_.swap(jobs_);
  }
  run_due(clock_->now());
  carry_out();
  probe_if_due();
  (void)guarded(log_, [&] { return store_->tidy(), Status(); });
  const std::scoped_lock lock(mutex_);
  std::optional<MonotonicTime> next;
  if (!later_.empty()) next = later_.front().due;
  if (!trouble_.empty()) next = next ? std::min(*next, probe_due_) : probe_due_;
  return next;
}

/// Runs the tasks that are due at first: what these put off to this moment has its turn next.
void MapPersistence::run_due(MonotonicTime now) {
  std::unique_lock lock(mutex_);
  const auto is_due = [&](const Later& task) { return task.due <= now; };
  for (auto left = std::count_if(later_.begin(), later_.end(), is_due); left > 0; --left) {
    const std::function<void()> task = std::move(later_.front().task);
    later_.erase(later_.begin());
    lock.unlock();
    (void)guarded(log_, [&] { return task(), Status(); });
    lock.lock();
  }
}

void MapPersistence::carry_out() {
  for (auto job = batch_.begin(); job != batch_.end(); ++job) {
    if (job->is_over) continue;
    if (job->task) {
      job->is_over = true;
      (void)guarded(log_, [&] { return job->task(*store_), Status(); });
      continue;
    }
    // All that this batch has of the map, up to a task, which keeps its place.
    const auto end = std::find_if(job, batch_.end(), [](const Job& other) { return other.task != nullptr; });
    write_group(job->map, {job, end});
  }
  batch_.clear();
}

/// Writes those of `jobs` that are of the map; the first is one. Nothing is written twice where a turn fails
/// between.
void MapPersistence::write_group(MapId map, std::span<Job> jobs) {
  if (Job& first = jobs.front(); first.creation && !first.outcome) {
    const auto created = std::make_shared<Status>();
    *created = guarded(log_, [&] { return store_->create(*first.creation, first.update); });
    first.outcome = created;
    finish(first);
  }
  const auto waits = [map](const Job& job) { return job.map == map && !job.is_over && !job.outcome; };
  if (std::any_of(jobs.begin(), jobs.end(), waits)) {
    const auto written = std::make_shared<Status>();
    *written = guarded(log_, [&] {
      std::vector<MapUpdate> updates;
      updates.reserve(jobs.size());
      for (Job& job : jobs) {
        if (waits(job)) updates.push_back(std::move(job.update));
      }
      return store_->write(map, updates);
    });
    for (Job& job : jobs) {
      if (waits(job)) job.outcome = written;
    }
  }
  for (Job& job : jobs) {
    if (job.map == map && !job.is_over) finish(job);
  }
}

void MapPersistence::finish(Job& job) {
  const Status& written = *job.outcome;
  (void)guarded(log_, [&] { return note(written), Status(); });
  job.is_over = true;
  if (job.done) {
    (void)guarded(log_, [&] { return job.done(written), Status(); });
  } else if (!written) {
    log_->error("map {}: {}", to_hex(job.map.bytes), written.error().message);
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
  note(guarded(log_, [this] { return store_->probe(); }));
}

}  // namespace cairn
