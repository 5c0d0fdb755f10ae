// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_versions.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <utility>

#include "server/mapping/crowding.h"
#include "server/service/store_tasks.h"
#include "server/store/compact_map.h"
#include "server/store/drop_contributor.h"

namespace cairn {
namespace {

/// Why nothing is done with the versions of a map; empty: it is.
std::string why_not(const MapEntry& entry, bool has_store) {
  if (entry.runner == nullptr) return kMadeElsewhere;
  if (!has_store) return kNoStore;
  if (entry.leaving) return "the map is being deleted";
  if (entry.rolling_back) return kRollingBack;
  return entry.name_to_be.empty() ? "" : "the map is being renamed; try again";
}

Status check_name(const char* what, const std::string& name) {
  if (is_valid_name(name)) return {};
  return fail(ErrorCode::kUsage, std::string(what) + " '" + name + "': expected 1 to 32 of a-z, 0-9 and -");
}

/// Whether a map is to be compacted: its places for points or for keyframes are nearly taken, many of them by
/// removed items (is_crowded()). What is published tells that, as removed items keep their slots.
bool wants_compaction(const MapSnapshot& map, const MapMakerOptions& options) {
  const auto made = [](const auto& blocks, size_t last) {
    return blocks.empty() ? 0 : (blocks.size() - 1) * kBlockSlots + last;
  };
  const size_t in_last = map.point_blocks.empty() ? 0 : map.point_blocks.back()->patches->points.size();
  const size_t keyframes_in_last =
      map.keyframe_blocks.empty() ? 0 : map.keyframe_blocks.back()->keyframes.size();
  return is_crowded(made(map.point_blocks, in_last), map.point_count(), options.max_points) ||
         is_crowded(made(map.keyframe_blocks, keyframes_in_last), map.keyframe_count(), kMaxKeyframes);
}

/// Who brought which keyframes of a map that are there, by name.
told::Contributors contributors_of(const MapSnapshot& map, std::span<const Contribution> known) {
  std::map<std::string, std::vector<uint64_t>> by_client;
  told::Contributors all{{}, map.keyframe_count()};
  for (const auto& [keyframe, client] : known) {
    if (map.find(keyframe) == nullptr) continue;
    by_client[client].push_back(keyframe.value);
    --all.unknown;
  }
  for (auto& [client, keyframes] : by_client) all.contributors.push_back({client, std::move(keyframes)});
  return all;
}

/// Called on the service's thread when the map can be stopped; the strand is held while `place` lives.
using Stoppable = std::function<void(MapEntry* entry, const HeldStrand::Hold& place)>;
/// Calls `then` when the map can be stopped, or answers why not. The map goes on with its work while an
/// archive or a backup, which others have under way beside the writer, is waited for.
void when_stoppable(const ServiceContext& context, ServedMaps& maps, MapId id, const AdminAnswer& answer,
                    Stoppable then) {
  context.store->hold_strand(
      [&context, &maps, id, answer, then = std::move(then)](const HeldStrand::Hold& place) {
        context.post([&maps, id, answer, then, place] {
          MapEntry* entry = maps.array().find(id);
          if (entry == nullptr) return answer(refusal(ErrorCode::kNotFound, "the map has gone meanwhile"));
          if (std::string why = why_not(*entry, true); !why.empty())
            return answer(refusal(ErrorCode::kRefused, std::move(why)));
          then(entry, place);
        });
      });
}

}  // namespace

void MapVersions::take(const std::string& operator_name, MapId id, MapEntry* entry,
                       const asked::OfVersions& ask, const AdminAnswer& answer) {
  if (std::string why = why_not(*entry, context_.store != nullptr); !why.empty())
    return answer(refusal(ErrorCode::kRefused, std::move(why)));
  const Meant map{id, entry, "operator " + operator_name};
  std::visit([&](const auto& one) { take(map, one, answer); }, ask);
}

bool MapVersions::is_unused(MapId id, const MapEntry& entry) const {
  return entry.snapshot != nullptr && entry.failed.empty() && entry.offers_in_work == 0 &&
         context_.now() - entry.used_at >= context_.options.compact_after && overview_.count_in(id) == 0;
}

void MapVersions::compact_crowded(MonotonicTime now) {
  constexpr std::chrono::hours kTriedAgainAfter{1};
  for (const auto& [id, entry] : maps_.array().all()) {
    if (!is_unused(id, entry) || !why_not(entry, true).empty()) continue;
    if (!wants_compaction(*entry.snapshot, context_.options.mapping)) continue;
    if (!capacity_.why_memory_is_full(bytes_of(entry) + bytes_to_page_in(entry)).empty()) continue;
    const auto [tried, is_first] = compaction_tried_at_.try_emplace(id, now);
    if (!is_first && now - tried->second < kTriedAgainAfter) continue;
    tried->second = now;
    compact(id, entry.name);
  }
}

void MapVersions::compact(MapId id, const std::string& name) {
  const auto done = [this, id, name](const OperatorAnswer& told) {
    const std::string outcome = told ? "done" : words_of(told.error());
    context_.site.note({0, context_.site.policy()->now(), "server", "compact", "map " + name, outcome});
    if (told) compaction_tried_at_.erase(id);
    if (!told) context_.log->warn("{} is nearly full, and cannot be compacted: {}", name, outcome);
    if (told) context_.log->info("{} was nearly full of what was removed from it, and is compacted", name);
  };
  const auto change = [id](Store& store, const AcceptState& accept) {
    return compact_map(&store, id, accept);
  };
  // Others may have been waited for, and somebody has come meanwhile.
  const auto in_place = [this, id, change, done](MapEntry* entry, const HeldStrand::Hold& place) {
    if (!is_unused(id, *entry)) return done(refusal(ErrorCode::kRefused, "somebody uses it again"));
    change_state_in_place(id, entry, change, place, done);
  };
  when_stoppable(context_, maps_, id, done, in_place);
}

MapTag MapVersions::tag_now(const Meant& map, const std::string& name) const {
  const MapStatistics& now = map.entry->statistics;
  return {0, name, context_.wall(), map.author, now.keyframes, now.points, 0, 0};
}

void MapVersions::take(const Meant& map, const asked::Tag& ask, const AdminAnswer& answer) {
  if (const Status named = check_name("tag", ask.tag); !named) return answer(refusal(named.error()));
  map.entry->runner->flush([this, id = map.id, tag = tag_now(map, ask.tag), answer](const Status& kept) {
    if (!kept) return context_.post(telling(answer, refusal(kept.error())));
    context_.store->run([this, id, tag, answer](Store& store) {
      const Status tagged = store.tag(id, tag);
      context_.post([tag, tagged, answer] { tagged ? answer(tag) : answer(refusal(tagged.error())); });
    });
  });
}

void MapVersions::take(const Meant& map, const asked::Untag& ask, const AdminAnswer& answer) {
  if (const Status named = check_name("tag", ask.tag); !named) return answer(refusal(named.error()));
  context_.store->run([this, id = map.id, tag = ask.tag, answer](Store& store) {
    const Status gone = store.untag(id, tag);
    context_.post(
        [answer, gone, tag] { gone ? answer(told::Untagged{tag}) : answer(refusal(gone.error())); });
  });
}

void MapVersions::take(const Meant& map, const asked::Tags& ask, const AdminAnswer& answer) {
  context_.store->run([this, id = map.id, after = ask.after, answer](Store& store) {
    context_.post([answer, after, tags = store.tags(id)] {
      if (!tags) return answer(refusal(tags.error()));
      told::Tags page;
      std::ranges::copy_if(*tags, std::back_inserter(page.tags),
                           [after](const MapTag& tag) { return tag.number > after; });
      answer(std::move(page));
    });
  });
}

/// A tag that is not there stops no map: it is looked up first. The map goes on while its roll-back waits:
/// what is tagged, and how much room it takes, is as it is when it stops.
void MapVersions::take(const Meant& map, const asked::RollBack& ask, const AdminAnswer& answer) {
  if (const Status named = check_name("tag", ask.tag); !named) return answer(refusal(named.error()));
  context_.store->run([this, id = map.id, author = map.author, name = ask.tag, answer](Store& store) {
    const auto tag = store.find_tag(id, name);
    if (!tag) return context_.post(telling(answer, refusal(tag.error())));
    context_.post([this, id, author, tag = *tag, answer] {
      const auto roll_back = [this, id, author, tag, answer](MapEntry* entry, const HeldStrand::Hold& place) {
        if (std::string why = why_tag_is_too_large(*entry, tag); !why.empty())
          return answer(refusal(ErrorCode::kRefused, std::move(why)));
        const MapTag before = tag_now({id, entry, author}, tag.name);
        const auto change = [id, name = tag.name, before](Store& s, const AcceptState& accept) {
          return s.roll_back(id, name, before, accept);
        };
        change_state_in_place(id, entry, change, place, answer);
      };
      when_stoppable(context_, maps_, id, answer, roll_back);
    });
  });
}

void MapVersions::take(const Meant& map, const asked::Contributors& ask, const AdminAnswer& answer) {
  context_.store->run(
      [this, id = map.id, snapshot = map.entry->snapshot, after = ask.after, answer](Store& store) {
        context_.post([answer, snapshot, after, known = store.contributions(id)] {
          if (!known) return answer(refusal(known.error()));
          told::Contributors page = contributors_of(*snapshot, *known);
          std::erase_if(page.contributors, [&](const told::Contributor& one) { return one.client <= after; });
          answer(std::move(page));
        });
      });
}

/// Nor does somebody who has no keyframe in it.
void MapVersions::take(const Meant& map, const asked::DropContributor& ask, const AdminAnswer& answer) {
  context_.store->run(
      [this, id = map.id, snapshot = map.entry->snapshot, client = ask.client, answer](Store& store) {
        const auto known = store.contributions(id);
        if (!known) return context_.post(telling(answer, refusal(known.error())));
        const bool has_any = std::ranges::any_of(contributors_of(*snapshot, *known).contributors,
                                                 [&](const auto& one) { return one.client == client; });
        context_.post([this, id, client, answer, has_any, nothing = no_contribution(client, snapshot->name)] {
          if (!has_any) return answer(refusal(nothing));
          const auto drop = [id, client](Store& s, const AcceptState& accept) {
            return drop_contributor(&s, id, client, accept);
          };
          change_state(id, drop, answer);
        });
      });
}

void MapVersions::take(const Meant& map, const asked::Copy& ask, const AdminAnswer& answer) {
  if (const Status named = check_name("name", ask.name); !named) return answer(refusal(named.error()));
  if (!maps_.array().names().is_free(ask.name))
    return answer(refusal(ErrorCode::kRefused, "another map is called '" + ask.name + "'"));
  std::string full = capacity_.why_full();
  if (full.empty()) full = capacity_.why_memory_is_full(bytes_of(*map.entry) + bytes_to_page_in(*map.entry));
  if (!full.empty()) return answer(refusal(ErrorCode::kRefused, std::move(full)));
  const MapId copy = maps_.array().ids().next();
  maps_.array().ids().reserve(copy);
  const auto make = [this, id = map.id, copy, name = ask.name, answer](const Store& store) -> Task {
    const Status copied = store.copy_map(id, copy, name);
    if (!copied) return telling(answer, refusal(copied.error()));
    administration_.take_in(copy, &Store::undo_import, answer);
    return {};
  };
  on_store_strand_when_kept(context_, *map.entry->runner, answer, make);
}

std::string MapVersions::why_tag_is_too_large(const MapEntry& entry, const MapTag& tag) const {
  const size_t now = bytes_of(entry) + bytes_to_page_in(entry);
  const size_t keyframes = std::max<size_t>(entry.statistics.keyframes, 1);
  const size_t then = now / keyframes * tag.keyframes;  // nearly all of it is theirs
  return then > now ? capacity_.why_memory_is_full(then - now) : std::string();
}

void MapVersions::change_state(MapId id, ChangeOfState change, const AdminAnswer& answer) {
  const auto in_place = [this, id, change = std::move(change), answer](MapEntry* entry,
                                                                       const HeldStrand::Hold& place) {
    change_state_in_place(id, entry, change, place, answer);
  };
  when_stoppable(context_, maps_, id, answer, in_place);
}

/// From the moment when the map's file becomes another, nothing of what the map was is written any more.
void MapVersions::change_state_in_place(MapId id, MapEntry* entry, ChangeOfState change,
                                        HeldStrand::Hold place, const AdminAnswer& answer) {
  entry->rolling_back = true;
  maps_.young().forget(id);
  const auto next = std::make_shared<std::optional<ResumedMap>>();
  const auto done = [this, id, next, runner = entry->runner, answer](const Status& changed) {
    if (!changed) runner->go_on_after_all();
    context_.post([this, id, next, answer, changed] {
      if (changed) return replace(std::move(**next), answer);
      if (MapEntry* stays = maps_.array().find(id)) stays->rolling_back = false;
      answer(refusal(changed.error()));
    });
  };
  const auto take = [this, next](RestoredMap map) { next->emplace(maps_.prepare(std::move(map))); };
  entry->runner->give_way(
      [this, id, change = std::move(change), place = std::move(place), take, done](const Status& kept) {
        if (!kept) return done(kept);
        context_.store->opening().change_state(id, context_.options.opening(),
                                               restored_images(context_.options.idle_after),
                                               {place, change, take, done});
      });
}

void MapVersions::replace(ResumedMap map, const AdminAnswer& answer) {
  const MapId id = map.header.id;
  const auto labels = maps_.replace(std::move(map));
  if (!labels) return answer(refusal(ErrorCode::kNotFound, "the map has gone meanwhile"));
  const MapEntry& entry = *maps_.array().find(id);
  for (const LabelId label : *labels) labels_.tell(id, entry, label);  // each names its epoch
  answer(overview_.describe(id, entry));
}

}  // namespace cairn
