// SPDX-License-Identifier: Apache-2.0
#include "server/service/simulation/curator.h"

#include <utility>

#include "server/access/rights_file.h"
#include "server/store/store_check.h"

namespace cairn::simulation {

using nlohmann::json;

json Curator::some_verb(MapId map) {
  constexpr size_t kMostMaps = 4;
  map_ = map;
  const std::string id = to_hex(map.bytes);
  if (!is_welcome_) return {{"verb", "proposals-welcome"}, {"map", "all"}, {"welcome", true}};
  switch (world_.draw(9)) {
    case 0:
      if (made_ > 0 && world_.chance(0.5)) break;  // one of a run is enough, mostly
      return {{"verb", "backup"}};
    case 1:
      if (world_.history.maps().size() >= kMostMaps) break;
      world_.history.asked_to_copy(map);
      return {{"verb", "copy"}, {"map", id}, {"name", "copy-" + std::to_string(++made_)}};
    case 2:
    case 3:
    case 4:
      if (waiting_.empty()) return {{"verb", "proposals"}};
      return some_decision();
    default:
      break;
  }
  return some_tag_verb(id);
}

json Curator::some_decision() {
  const auto [map, proposal] = waiting_[world_.draw(waiting_.size())];
  map_ = map;
  if (world_.chance(0.3)) return {{"verb", "proposal-drop"}, {"proposal", proposal}};
  world_.history.asked_to_accept(map);
  return {{"verb", "proposal-accept"}, {"proposal", proposal}};
}

json Curator::some_tag_verb(const std::string& id) {
  const std::set<std::string> tags = world_.history.tags_of(map_);
  if (tags.empty() || world_.chance(0.4)) {
    world_.history.asked_to_tag(map_);
    return {{"verb", "tag"}, {"map", id}, {"tag", "tag-" + std::to_string(++made_)}};
  }
  const std::string& tag = *std::next(tags.begin(), static_cast<std::ptrdiff_t>(world_.draw(tags.size())));
  world_.history.asked_to_roll_back(map_, tag);
  return {{"verb", "roll-back"}, {"map", id}, {"tag", tag}};
}

void Curator::hear(const json& asked, const wire::AdminReply& reply) {
  const std::string verb = asked.at("verb");
  if (reply.result == 0) {
    const json told = json::parse(reply.text);
    hear_done(verb, asked, told);
    return go_on_with_backup(verb, told, reply);
  }
  if (verb == "roll-back") world_.history.not_rolled_back(map_);
  if (verb.starts_with("proposal-")) waiting_.clear();  // as they are now, he asks again
  taking_.reset();
}

void Curator::hear_done(const std::string& verb, const json& asked, const json& told) {
  if (verb == "proposals-welcome") {
    is_welcome_ = true;
  } else if (verb == "tag") {
    ++done_.tags;
    world_.history.tagged(map_, asked.at("tag"));
  } else if (verb == "roll-back") {
    ++done_.roll_backs;
    world_.history.rolled_back(map_);
  } else if (verb == "copy") {
    ++done_.copies;
    const MapId copy{*from_hex(told.at("id").get<std::string>())};
    world_.places.emplace(copy, world_.places.at(map_));
    world_.history.copied(map_, copy, asked.at("name"));
  } else if (verb == "proposals") {
    hear_proposals(told);
  } else if (verb == "proposal-accept") {
    ++done_.accepted;
    world_.history.decided(asked.at("proposal"), map_, KeyframeId{told.at("keyframe").get<uint64_t>()});
    waiting_.clear();
  } else if (verb == "proposal-drop") {
    ++done_.dropped;
    world_.history.decided(asked.at("proposal"), map_, std::nullopt);
    waiting_.clear();
  }
}

void Curator::hear_proposals(const json& told) {
  waiting_.clear();
  for (const json& proposal : told.at("proposals")) {
    const std::string id = proposal.at("id");
    world_.history.proposed(id);
    waiting_.emplace_back(MapId{*from_hex(proposal.at("map").get<std::string>())}, id);
  }
  if (!waiting_.empty() && world_.chance(0.8)) ask(some_decision());
}

void Curator::go_on_with_backup(const std::string& verb, const json& told, const wire::AdminReply& reply) {
  if (verb == "backup") {
    Taking taking;
    taking.parts = told.at("parts").get<std::vector<std::string>>();
    taking.file = folder_ / ("backup-" + std::to_string(++made_));
    auto writer = BackupWriter::create(taking.file);
    if (!writer) return world_.history.violated(writer.error().message);
    taking.writer.emplace(std::move(*writer));
    taking_.emplace(std::move(taking));
    return ask_for_part();
  }
  if (!taking_) return;
  if (verb == "backup-part") {
    if (told.value("gone", false))
      return taking_.reset();  // deleted or put back since, as another tries then
    taking_->token = told.at("token");
    taking_->bytes = told.at("bytes");
    taking_->offset = 0;
    taking_->part.open(part_path(), std::ios::binary | std::ios::trunc);
    return ask_for_piece();
  }
  if (verb != "export-read") return;
  taking_->part.write(reinterpret_cast<const char*>(reply.data.data()),
                      static_cast<std::streamsize>(reply.data.size()));
  taking_->offset += reply.data.size();
  if (taking_->offset < taking_->bytes) return ask_for_piece();
  taking_->part.close();
  const Status added = taking_->writer->add(taking_->parts[taking_->next], part_path());
  if (!added) return world_.history.violated(added.error().message);
  ++taking_->next;
  ask_for_part();
}

void Curator::ask_for_part() {
  if (taking_->next < taking_->parts.size()) {
    const std::string& part = taking_->parts[taking_->next];
    const auto map = from_hex(std::filesystem::path(part).stem().string());
    const auto made = world_.history.made_so_far();
    if (const auto known = map ? made.find(MapId{*map}) : made.end(); known != made.end())
      taking_->known.insert(*known);
    return ask({{"verb", "backup-part"}, {"part", part}});
  }
  const Status finished = taking_->writer->finish(world_.clock->wall(), "simulated");
  if (!finished) world_.history.violated("a backup: " + finished.error().message);
  taken_.push_back({taking_->file, std::move(taking_->known)});
  taking_.reset();
}

void Curator::ask_for_piece() {
  ask({{"verb", "export-read"}, {"token", taking_->token}, {"offset", taking_->offset}});
}

void Curator::check_backups() {
  for (const Taken& taken : std::exchange(taken_, {})) {
    const std::filesystem::path unpacked = folder_ / ("unpacked-" + std::to_string(++made_));
    const std::filesystem::path store = folder_ / ("restored-" + std::to_string(made_));
    const auto content = read_backup(taken.file, unpacked, [](uint64_t, uint64_t) {});
    const auto check_rights = [](const std::string& text) -> Status {
      const auto rights = read_rights(text);
      return rights ? Status() : tl::unexpected(rights.error());
    };
    const Status restored =
        content ? settle_restored(unpacked, store, check_rights, "otto") : tl::unexpected(content.error());
    if (!restored) {
      world_.history.violated("a backup cannot be restored: " + restored.error().message);
      continue;
    }
    world_.history.check_restored(store, taken.known);
    ++done_.restored;
    std::filesystem::remove_all(store);
  }
}

}  // namespace cairn::simulation
