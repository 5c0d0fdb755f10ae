// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <utility>

#include "common/base/utc.h"
#include "server/service/admin_reply.h"
#include "server/service/admin_request.h"
#include "server/service/map_service.h"
#include "server/store/drop_contributor.h"

/// Versions of a map: tags, roll-backs, copies. What is in the file is done by the store's writer, in its
/// turn: behind all that the map has handed in.
namespace cairn {
namespace {

using asked::text_of;
using nlohmann::json;

json describe(const MapTag& tag) {
  return {{"number", tag.number},       {"tag", tag.name},     {"time", to_utc(tag.time)}, {"by", tag.author},
          {"keyframes", tag.keyframes}, {"points", tag.points}};
}

/// "1-3 7 9-12", cut short where it is very long.
std::string ranges_of(const std::vector<uint64_t>& ascending) {
  constexpr size_t kMostBytes = 2000;
  std::string text;
  for (size_t i = 0; i < ascending.size() && text.size() < kMostBytes;) {
    size_t last = i;
    while (last + 1 < ascending.size() && ascending[last + 1] == ascending[last] + 1) ++last;
    text += fmt::format("{}{}", text.empty() ? "" : " ", ascending[i]);
    if (last > i) text += fmt::format("-{}", ascending[last]);
    i = last + 1;
  }
  return text.size() < kMostBytes ? text : text + " ...";
}

/// Why nothing is done with the versions of a map; empty: it is.
std::string why_not(const MapEntry& entry, bool has_store) {
  if (entry.runner == nullptr) return "this map is made elsewhere";
  if (!has_store) return kNoStore;
  if (entry.leaving) return "the map is being deleted";
  if (entry.rolling_back) return kRollingBack;
  return entry.name_to_be.empty() ? "" : "the map is being renamed; try again";
}

}  // namespace

bool MapService::keeps_versions(const std::string& operator_name, MapId id, MapEntry* entry,
                                const json& request, const AdminAnswer& answer) {
  const std::string verb = text_of(request, "verb");
  const bool is_one = verb == "tag" || verb == "tags" || verb == "untag" || verb == "roll-back" ||
                      verb == "copy" || verb == "contributors" || verb == "drop-contributor";
  if (!is_one) return false;
  if (std::string why = why_not(*entry, store_ != nullptr); !why.empty()) {
    answer(refusal(ErrorCode::kRefused, std::move(why)));
    return true;
  }
  const std::string tag = text_of(request, "tag");
  const MapTag now{0,
                   tag,
                   clock_.wall(),
                   "operator " + operator_name,
                   entry->statistics.keyframes,
                   entry->statistics.points,
                   0,
                   0};
  if (verb == "tags") {
    const auto after = request.find("after");
    list_tags(id, after != request.end() && after->is_number_unsigned() ? after->get<uint64_t>() : 0, answer);
  } else if (verb == "contributors") {
    list_contributors(id, *entry, text_of(request, "after"), answer);
  } else if (verb == "drop-contributor") {
    drop_contributor_of(id, entry->snapshot, text_of(request, "client"), answer);
  } else if (verb == "copy") {
    copy_map(id, *entry, text_of(request, "name"), answer);
  } else if (!is_valid_name(tag)) {
    answer(refusal(ErrorCode::kUsage, "tag '" + tag + "': expected 1 to 32 of a-z, 0-9 and -"));
  } else if (verb == "tag") {
    tag_map(id, *entry, now, answer);
  } else if (verb == "roll-back") {
    roll_back_map(id, tag, now, answer);
  } else {
    store_->run([this, id, tag, answer](Store& store) {
      const Status gone = store.untag(id, tag);
      post_([answer, gone, tag] { answer(gone ? success({{"tag", tag}}) : refusal(gone.error())); });
    });
  }
  return true;
}

void MapService::tag_map(MapId id, const MapEntry& entry, MapTag tag, const AdminAnswer& answer) {
  entry.runner->flush([this, id, tag = std::move(tag), answer](const Status& kept) {
    if (!kept) return post_([answer, error = kept.error()] { answer(refusal(error)); });
    store_->run([this, id, tag, answer](Store& store) {
      const Status tagged = store.tag(id, tag);
      const json told = describe(tag);
      post_([answer, tagged, told] { answer(tagged ? success(told) : refusal(tagged.error())); });
    });
  });
}

void MapService::list_tags(MapId id, uint64_t after, const AdminAnswer& answer) {
  store_->run([this, id, after, answer](Store& store) {
    const auto tags = store.tags(id);
    if (!tags) return post_([answer, error = tags.error()] { answer(refusal(error)); });
    ReplyPage page{"tags"};
    for (const MapTag& tag : *tags) {
      if (tag.number > after && !page.add("tags", describe(tag))) break;
    }
    post_([answer, told = page.content()] { answer(success(told)); });
  });
}

/// A tag that is not there stops no map: it is looked up first.
void MapService::roll_back_map(MapId id, const std::string& name, MapTag before, const AdminAnswer& answer) {
  store_->run([this, id, name, before = std::move(before), answer](Store& store) {
    const auto tag = store.find_tag(id, name);
    post_([this, id, tag, before, answer] {
      MapEntry* entry = maps_.find(id);
      if (!tag || entry == nullptr) return answer(tag ? unknown_map(to_hex(id.bytes)) : refusal(tag.error()));
      if (std::string why = why_tag_is_too_large(*entry, *tag); !why.empty())
        return answer(refusal(ErrorCode::kRefused, std::move(why)));
      const auto roll_back = [id, name = tag->name, before](Store& s, const AcceptState& accept) {
        return s.roll_back(id, name, before, accept);
      };
      change_state(id, roll_back, answer);
    });
  });
}

/// Nor does somebody who has no keyframe in it.
void MapService::drop_contributor_of(MapId id, const MapSnapshotPtr& map, const std::string& client,
                                     const AdminAnswer& answer) {
  store_->run([this, id, map, client, answer](Store& store) {
    const auto known = store.contributions(id);
    if (!known) return post_([answer, error = known.error()] { answer(refusal(error)); });
    const bool has_any = std::ranges::any_of(
        *known, [&](const Contribution& c) { return c.second == client && map->find(c.first) != nullptr; });
    const Error nothing = no_contribution(client, map->name);
    post_([this, id, client, answer, has_any, nothing] {
      if (!has_any) return answer(refusal(nothing));
      const auto drop = [id, client](Store& s, const AcceptState& accept) {
        return drop_contributor(&s, id, client, accept);
      };
      change_state(id, drop, answer);
    });
  });
}

void MapService::list_contributors(MapId id, const MapEntry& entry, const std::string& after,
                                   const AdminAnswer& answer) {
  store_->run([this, id, map = entry.snapshot, after, answer](Store& store) {
    const auto known = store.contributions(id);
    if (!known) return post_([answer, error = known.error()] { answer(refusal(error)); });
    std::map<std::string, std::vector<uint64_t>> by_client;
    size_t others = map->keyframe_count();
    for (const auto& [keyframe, client] : *known) {
      if (map->find(keyframe) == nullptr) continue;
      by_client[client].push_back(keyframe.value);
      --others;
    }
    ReplyPage page{"contributors"};
    for (const auto& [client, keyframes] : by_client) {
      const json told{{"client", client}, {"keyframes", keyframes.size()}, {"ids", ranges_of(keyframes)}};
      if (client > after && !page.add("contributors", told)) break;
    }
    json told = page.content();
    told["unknown"] = others;
    post_([answer, told] { answer(success(told)); });
  });
}

std::string MapService::why_tag_is_too_large(const MapEntry& entry, const MapTag& tag) const {
  const size_t now = bytes_of(entry) + bytes_to_wake(entry);
  const size_t keyframes = std::max<size_t>(entry.statistics.keyframes, 1);
  const size_t then = now / keyframes * tag.keyframes;  // nearly all of it is theirs
  return then > now ? why_memory_is_full(then - now) : std::string();
}

/// What others have going on beside the writer, an archive or a backup, is waited for with the map at work.
void MapService::change_state(MapId id, ChangeOfState change, const AdminAnswer& answer) {
  store_->hold_beside([this, id, change = std::move(change), answer](const HeldLane::Hold& place) {
    post_([this, id, change, answer, place] {
      MapEntry* entry = maps_.find(id);
      if (entry == nullptr) return answer(refusal(ErrorCode::kNotFound, "the map has gone meanwhile"));
      if (std::string why = why_not(*entry, true); !why.empty())
        return answer(refusal(ErrorCode::kRefused, std::move(why)));
      change_state_in_place(id, entry, change, place, answer);
    });
  });
}

/// From the moment when the map's file becomes another, nothing of what the map was is written any more.
void MapService::change_state_in_place(MapId id, MapEntry* entry, ChangeOfState change, HeldLane::Hold place,
                                       const AdminAnswer& answer) {
  entry->rolling_back = true;
  young_.forget(id);
  const auto next = std::make_shared<std::optional<ResumedMap>>();
  const auto done = [this, id, next, runner = entry->runner, answer](const Status& changed) {
    if (!changed) runner->go_on_after_all();
    post_([this, id, next, answer, changed] {
      if (changed) return replace_map(std::move(**next), answer);
      if (MapEntry* stays = maps_.find(id)) stays->rolling_back = false;
      answer(refusal(changed.error()));
    });
  };
  const auto take = [this, next](RestoredMap map) { next->emplace(prepare(std::move(map))); };
  entry->runner->give_way(
      [this, id, change = std::move(change), place = std::move(place), take, done](const Status& kept) {
        if (!kept) return done(kept);
        store_->change_state(id, options_.mapping, restored_images(options_.rest_after),
                             {place, change, take, done});
      });
}

void MapService::replace_map(ResumedMap map, const AdminAnswer& answer) {
  const MapId id = map.header.id;
  MapEntry* entry = maps_.find(id);
  if (entry == nullptr) return answer(refusal(ErrorCode::kNotFound, "the map has gone meanwhile"));
  std::set<LabelId> labels;
  for (const Label& label : entry->labels.all()) labels.insert(label.id);
  // Somebody may yet mean by an id a label that the roll-back takes away.
  const LabelId last_given = std::max(entry->labels.last_given(), map.last_label);
  entry->labels = LabelBook();
  entry->labels.restore(map.labels, last_given);
  for (const Label& label : entry->labels.all()) labels.insert(label.id);
  proposals_.restore(id, std::move(map.proposals), map.last_proposal);
  // Offers to the state before end with the runner that judges them.
  while (entry->offers_in_work > 0) maps_.end_offer(entry);
  entry->runner = map.runner;
  entry->plane_aligned = map.plane_aligned;
  entry->epochs = std::move(map.epochs);
  entry->frozen.clear();
  entry->rolling_back = false;
  on_map_changed(id, std::move(map.first));
  for (const LabelId label : labels) tell_label(id, *entry, label);  // each names its epoch
  entry->runner->go_on();
  answer(success(describe_map(id, *entry)));
}

void MapService::copy_map(MapId id, const MapEntry& entry, const std::string& name,
                          const AdminAnswer& answer) {
  if (!is_valid_name(name))
    return answer(refusal(ErrorCode::kUsage, "name '" + name + "': expected 1 to 32 of a-z, 0-9 and -"));
  if (!maps_.is_free(name))
    return answer(refusal(ErrorCode::kRefused, "another map is called '" + name + "'"));
  std::string full = why_full();
  if (full.empty()) full = why_memory_is_full(bytes_of(entry) + bytes_to_wake(entry));
  if (!full.empty()) return answer(refusal(ErrorCode::kRefused, std::move(full)));
  const MapId copy = maps_.next_id();
  maps_.reserve(copy);
  const auto make = [this, id, copy, name, answer](const Store& store) -> Task {
    const Status copied = store.copy_map(id, copy, name);
    if (!copied) return [answer, error = copied.error()] { answer(refusal(error)); };
    take_in(copy, &Store::undo_import, answer);
    return {};
  };
  entry.runner->flush([this, answer, make](const Status& kept) {
    if (!kept) return post_([answer, error = kept.error()] { answer(refusal(error)); });
    store_->run([this, answer, make](const Store&) { with_store(answer, make); });
  });
}

}  // namespace cairn
