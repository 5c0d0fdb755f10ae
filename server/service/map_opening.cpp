// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_opening.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <new>
#include <utility>

#include "server/service/client.h"

namespace cairn {
namespace {

constexpr size_t kDeletedRemembered = 64;  ///< maps
/// Number of the last decisions that are remembered of each deleted map: as many as all clients may have in
/// flight. A client knows what came of commands before these; if it does not, it is told that the map is not
/// there. The decision on the seed, which would be made again, is remembered besides.
constexpr int64_t kDecisionsRemembered = 2 * kMaxClients * OfferGate::kCredit;
static_assert(OfferGate::kCredit == RequestGate::kCredit);

/// Keyframe views, for the index, of a map maker without images: these are taken from `images`.
std::vector<KeyframeView> views_with_images(const MapMaker& maker, const std::vector<ImageRecord>& images) {
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

Status guarded(const Logger& log, const std::function<Status()>& work) {
  try {
    return work();
  } catch (const std::bad_alloc&) {  // there may be some soon
    log->error("no memory while keeping maps");
    return fail(ErrorCode::kIo, "no memory");
  } catch (const std::exception& problem) {
    log->error("internal error while keeping maps: {}", problem.what());
    return fail(ErrorCode::kInternal, "internal error; the server's log says more");
  }
}

std::vector<DeletedDecisions> MapOpening::decisions_on_deleted() const {
  return with_.store.decisions_on_deleted(kDeletedRemembered, kDecisionsRemembered);
}

/// A restored map, or one that has to be set aside.
struct MapOpening::Loaded {
  MapId map;
  std::string name;  ///< as far as it is known
  Result<RestoredMap> restored = fail(ErrorCode::kInternal, "not loaded");
  std::vector<std::string> damage;
};

MapOpening::Loaded MapOpening::load(MapId map, const OpeningOptions& options, RestoredImages images) const {
  Result<StoredMap> stored = fail(ErrorCode::kInternal, "not loaded");
  try {
    stored = with_.store.load(map);
  } catch (const std::exception& problem) {  // memory
    stored = fail(ErrorCode::kInternal, std::string("cannot be loaded: ") + problem.what());
  }
  return make_ready(map, std::move(stored), options, images);
}

MapOpening::Loaded MapOpening::make_ready(MapId map, Result<StoredMap> stored, const OpeningOptions& options,
                                          RestoredImages images) {
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
    auto made = MapMaker::restore(stored->record, {header.id, header.name, header.epoch}, options.mapping,
                                  RestoredImages::kEvicted);
    if (!made) return fail_with(made.error());
    loaded.damage.insert(loaded.damage.end(), made->repairs.begin(), made->repairs.end());
    MapMaker& maker = *made->maker;
    IndexedMapPtr indexed = index_map(nullptr, maker.snapshot(),
                                      views_with_images(maker, stored->record.images), options.gravity);
    if (images == RestoredImages::kStay || !loaded.damage.empty() || maker.has_work()) {
      for (const ImageRecord& r : stored->record.images)
        (void)maker.page_in_image(r.keyframe, r.image->view());
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

Result<RestoredMap> MapOpening::settle(Loaded loaded) {
  const std::string name = to_hex(loaded.map.bytes);
  for (const std::string& line : loaded.damage) with_.log->error("map {}: {}", name, line);
  if (!loaded.restored) return std::move(loaded.restored);
  forget_unloaded(loaded.map);
  RestoredMap& map = *loaded.restored;
  if (!loaded.damage.empty()) {
    MapUpdate saved{map.maker->take_changes(), map.decisions, map.labels, {}, map.contributions};
    saved.last_proposal = map.last_proposal;
    map.proposals.clear();  // they stay in the damaged file
    const auto aside = with_.store.replace(map.header, saved, loaded.damage);
    with_.log->error("map {} ({}) goes on without what is damaged; {}", name, map.header.name,
                     aside ? "the damaged file is kept as " + aside->string() : aside.error().message);
  }
  return std::move(loaded.restored);
}

void MapOpening::part_with(const Loaded& failed) {
  const Error& error = failed.restored.error();
  if (error.code != ErrorCode::kDamaged) return leave_alone(failed.map, failed.name, error.message);
  std::vector<std::string> reasons = failed.damage;
  reasons.push_back(error.message);
  const auto aside = with_.store.set_aside(failed.map, failed.name, reasons);
  if (!aside) return leave_alone(failed.map, failed.name, error.message + "; " + aside.error().message);
  with_.log->error("map {} cannot be used: {}; kept as {}", to_hex(failed.map.bytes), error.message,
                   aside->string());
}

std::vector<UnloadedMap> MapOpening::unloaded() const {
  std::unique_lock lock(mutex_);
  std::vector<UnloadedMap> maps = unloaded_;
  lock.unlock();
  std::erase_if(maps, [](const UnloadedMap& map) {
    std::error_code ignored;  // a link into nowhere lies there, too
    return !std::filesystem::exists(std::filesystem::symlink_status(map.file, ignored));
  });
  return maps;
}

void MapOpening::leave_alone(MapId map, const std::string& name, const std::string& reason) {
  with_.log->error("map {} is left alone: {}", to_hex(map.bytes), reason);
  forget_unloaded(map);
  const std::scoped_lock lock(mutex_);
  unloaded_.push_back({map, name, with_.store.path_of(map), reason});
}

void MapOpening::forget_unloaded(MapId map) {
  const std::scoped_lock lock(mutex_);
  std::erase_if(unloaded_, [map](const UnloadedMap& other) { return other.map == map; });
}

std::vector<RestoredMap> MapOpening::restore(const OpeningOptions& options, const Parallel& parallel,
                                             RestoredImages images) {
  const std::vector<MapId> maps = with_.store.maps();
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

void MapOpening::restore_one(MapId map, const OpeningOptions& options, RestoredImages images, Undo undo,
                             std::function<void(Result<RestoredMap>)> done) {
  auto loaded = std::make_shared<Loaded>(load(map, options, images));
  with_.run([this, loaded, undo, done = std::move(done)](Store&) {
    if (!loaded->restored) take_back(loaded->map, loaded->name, undo, loaded->restored.error().message);
    done(settle(std::move(*loaded)));
  });
}

void MapOpening::change_state(MapId map, const OpeningOptions& options, RestoredImages images,
                              StateChange how) {
  with_.run([this, map, options, images, how = std::move(how)](Store& writers) {
    writers.close(map);
    with_.strand->submit_within(how.place, [this, map, options, images, how] {
      Store& store = with_.store;
      const AcceptState accept = [&](StoredMap state) -> Status {
        store.note_lost_proposals(map, state);
        Loaded loaded = make_ready(map, std::move(state), options, images);
        if (!loaded.damage.empty()) return fail(ErrorCode::kDamaged, loaded.damage.front());
        if (!loaded.restored) return tl::unexpected(loaded.restored.error());
        how.take(std::move(*loaded.restored));
        return {};
      };
      const Status changed = guarded(with_.log, [&] { return how.change(store, accept); });
      with_.run([map, how, changed](Store& same) {
        same.close(map);
        how.done(changed);
      });
    });
  });
}

void MapOpening::take_back(MapId map, const std::string& name, Undo undo, const std::string& reason) {
  with_.log->error("map {} cannot be served: {}", to_hex(map.bytes), reason);
  const Status undone = (with_.store.*undo)(map);
  if (!undone) leave_alone(map, name, reason + "; " + undone.error().message);
}

}  // namespace cairn
