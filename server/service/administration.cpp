// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <exception>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "common/base/utc.h"
#include "common/base/utf8.h"
#include "common/base/version.h"
#include "common/io/json_text.h"
#include "server/service/admin_reply.h"
#include "server/service/admin_request.h"
#include "server/service/map_service.h"

/// What operators ask for (idl/README.md, AdminRequest).
namespace cairn {
namespace {

using asked::is_set;
using asked::number_of;
using asked::text_of;
using nlohmann::json;

constexpr size_t kLoggedBytes = 200;       ///< of a request
constexpr size_t kMostOverlapsTold = 100;  ///< of a map: it must fit into a page

/// What it is to an operator that a label is not changed.
ErrorCode error_of(wire::RequestDecision decision) {
  if (decision == wire::RequestDecision::kUnfit) return ErrorCode::kUsage;
  // No label is added here: nothing is full but the disk.
  return decision == wire::RequestDecision::kFull ? ErrorCode::kIo : ErrorCode::kRefused;
}

OperatorAct act_of(const std::string& verb) {
  // Who looks after maps may close one to everybody; whom it is open to is for others to say.
  const bool is_about_map = verb == "map-freeze" || verb == "map-unfreeze";
  if (changes_rights(verb) && !is_about_map) return OperatorAct::kGovern;
  const bool is_transfer = verb == "export" || verb == "proposal-show" || verb == "proposal-picture" ||
                           verb == "import" || verb.starts_with("export-") || verb.starts_with("import-") ||
                           verb.starts_with("backup");
  if (is_transfer) return OperatorAct::kTransfer;
  if (verb.starts_with("verify")) return OperatorAct::kExamine;
  const bool is_look = verb == "status" || verb == "rigs" || verb == "maps" || verb == "show" ||
                       verb == "labels" || verb == "rights" || verb == "rights-explain" ||
                       verb == "clients" || verb == "audit" || verb == "tags" || verb == "contributors" ||
                       verb == "proposals";
  return is_look ? OperatorAct::kSee : OperatorAct::kChange;
}

/// Of an archive or a store: asked for in hundreds, and what began it is on record.
bool is_piece(const std::string& verb) {
  return verb == "import-write" || verb == "export-read" || verb == "backup-part" ||
         verb == "proposal-picture" || verb == "verify-part";
}

bool is_audited(const std::string& verb) {
  return act_of(verb) != OperatorAct::kSee && !is_piece(verb);
}

/// Onto a page, from a number on, as many as fit.
template <typename Item, typename Describe>
void add_from(size_t begin, const std::vector<Item>& items, const char* list, ReplyPage* page,
              Describe describe_one) {
  for (size_t i = begin; i < items.size(); ++i) {
    if (!page->add(list, describe_one(items[i]))) return;
  }
}

/// What stands beside the health; `maps` has all.
template <typename Item, typename Describe>
json first_of(const std::vector<Item>& items, Describe describe_one) {
  constexpr size_t kMostTold = 10;
  json told = json::array();
  for (size_t i = 0; i < std::min(items.size(), kMostTold); ++i) told.push_back(describe_one(items[i]));
  return told;
}

}  // namespace

/// A request of an operator, from when it is taken on until it is answered. One whose answer is lost, with an
/// exception or a task that is dropped, is answered with that: its place is given back whatever happens.
class MapService::Ticket {
 public:
  using Answer = std::function<void(wire::AdminReply reply)>;
  Ticket(Answer answer, Post post) : answer_(std::move(answer)), post_(std::move(post)) {}
  ~Ticket() {
    if (answer_) post_([answer = std::move(answer_)] { answer(refusal(ErrorCode::kInternal, kLost)); });
  }
  Ticket(const Ticket&) = delete;
  Ticket& operator=(const Ticket&) = delete;

  void answer(wire::AdminReply reply) {
    if (const Answer once = std::exchange(answer_, nullptr)) once(std::move(reply));
  }

 private:
  static constexpr const char* kLost = "internal error; the server's log says more";
  Answer answer_;
  const Post post_;
};

void MapService::take(const Principal& who, const wire::AdminRequest& message) {
  const std::string& operator_name = who.name;
  const auto tell = [this, operator_name, command = message.command](wire::AdminReply reply) {
    reply.operator_id = client_id_from_name(operator_name);
    reply.command = command;
    if (reply.result != 0) log_->info("operator {}: refused: {}", operator_name, reply.text);
    const wire::CommandId answered = reply.command;
    admin_gate_.answered(operator_name, std::move(reply), clock_.now());
    repeat_answer(operator_name, answered);
  };
  const AdminGate::Judgement judged = admin_gate_.admit(operator_name, message.command, clock_.now());
  switch (judged.admission) {
    case AdminGate::Admission::kNew:
      break;
    case AdminGate::Admission::kInWork:
      return;
    case AdminGate::Admission::kRepeated:
      return repeat_answer(operator_name, message.command);
    case AdminGate::Admission::kRefused:
      return refuse_for_now(operator_name, message.command, judged.why);
  }
  const AdminAnswer answer = [ticket = std::make_shared<Ticket>(tell, post_)](wire::AdminReply reply) {
    ticket->answer(std::move(reply));
  };
  try {
    carry_out(who, message, answer);
  } catch (const std::exception& problem) {
    log_->error("internal error in a request of operator {}: {}", operator_name, problem.what());
    answer(refusal(ErrorCode::kInternal, "internal error; the server's log says more"));
  }
}

/// Not in the log: there may be many.
void MapService::refuse_for_now(const std::string& operator_name, wire::CommandId command,
                                const std::string& why) {
  wire::AdminReply reply = refusal(ErrorCode::kRefused, why);
  reply.operator_id = client_id_from_name(operator_name);
  reply.command = command;
  admin_gate_.answered(operator_name, std::move(reply), clock_.now());
  repeat_answer(operator_name, command);
}

void MapService::carry_out(const Principal& who, const wire::AdminRequest& message, const AdminAnswer& tell) {
  const std::string& operator_name = who.name;
  const json request = parse_admin_request(message.request);
  if (!request.is_object()) return tell(refusal(ErrorCode::kUsage, "a request that is no JSON object"));
  const std::string verb = text_of(request, "verb");
  if (verb.empty()) return tell(refusal(ErrorCode::kUsage, "a request without 'verb', a text"));
  const AdminAnswer answer = is_audited(verb) ? audited(operator_name, verb, request, tell) : tell;
  const std::string wanted = text_of(request, "map");
  log_->log(is_piece(verb) ? spdlog::level::debug : spdlog::level::info, "operator {}: {}", operator_name,
            cut_text(json_text(request), kLoggedBytes));
  if (const Status may = options_.access->may_ask(who, act_of(verb)); !may)
    return answer(refusal(may.error()));
  if (administers_access(operator_name, verb, request, answer)) return;
  if (looks_after_store(operator_name, request, answer)) return;
  if (decides_proposals(request, answer)) return;
  if (verb == "status") return describe_server(answer);
  if (verb == "rigs") return answer(success({{"rigs", rigs_.describe(clock_.now())}}));
  if (verb == "maps") {
    return list_maps({text_of(request, "after"), number_of(request, "deleted_from"),
                      number_of(request, "damaged_from"), number_of(request, "unloaded_from")},
                     answer);
  }
  if (verb == "undelete") return undelete_map(wanted, answer);
  if (verb == "purge") return purge_map(wanted, answer);
  if (verb == "import") return import_map(text_of(request, "token"), answer);
  if (verb == "import-begin" || is_piece(verb))
    return transfer(verb, text_of(request, "token"), number_of(request, "offset"), message.data, answer);

  const auto [id, entry] = find_map(wanted);
  if (entry == nullptr) return answer_without_map(verb, wanted, answer);
  if (verb == "show") return show_map(id, *entry, answer);
  if (verb == "rename") return rename_map(id, entry, text_of(request, "name"), answer);
  if (verb == "delete") return delete_map(id, entry, is_set(request, "for_good"), answer);
  if (verb == "export") return export_map(id, entry, answer);
  if (keeps_versions(operator_name, id, entry, request, answer)) return;
  const LabelId label{number_of(request, "label")};
  if (verb == "labels") return answer(success(describe_labels(entry->name, entry->labels.all(), label)));
  if (verb == "label-rename" || verb == "label-remove") {
    wire::ClientRequest wish;
    wish.action =
        verb == "label-rename" ? wire::RequestAction::kRenameLabel : wire::RequestAction::kRemoveLabel;
    wish.map = id;
    wish.label = label;
    wish.text = text_of(request, "text");
    return edit_label(*entry, wish, who, answer);
  }
  answer(refusal(ErrorCode::kUsage, "this server does not know '" + verb + "'"));
}

void MapService::repeat_answer(const std::string& operator_name, wire::CommandId command) {
  const wire::AdminReply* reply = admin_gate_.last({operator_name, command.session});
  if (reply == nullptr) return;
  const Status written = output_.answer(operator_name, *reply);
  if (!written && output_trouble_.due(clock_.now()))
    log_->error("operator {} cannot be answered: {}", operator_name, written.error().message);
}

std::pair<MapId, MapEntry*> MapService::find_map(const std::string& name_or_id) {
  for (const auto& [id, entry] : maps_.all()) {
    if (entry.snapshot != nullptr && (entry.name == name_or_id || to_hex(id.bytes) == name_or_id))
      return {id, maps_.find(id)};
  }
  return {};
}

void MapService::describe_server(const AdminAnswer& answer) {
  json clients = json::array();
  json wearers = json::object();
  for (const auto& [name, client] : clients_) {
    if (!client.connected) continue;
    clients.push_back(name);
    if (const std::string wearer = wearers_.wearer_of(name); !wearer.empty()) wearers[name] = wearer;
  }
  json damaged = first_of(
      damaged_, [this](const DamagedFile& file) { return describe(file, maps_.find(file.map) != nullptr); });
  answer(success({{"server", to_hex(options_.server.bytes)},
                  {"version", std::string(version())},
                  {"start_count", options_.start_count},
                  {"health", health()},
                  {"store", store_ ? one_line(store_->folder().string()) : std::string()},
                  {"maps", maps_.live_count()},
                  {"maps_at_rest", maps_.resting_count()},
                  {"memory_bytes", maps_.bytes()},
                  {"limits",
                   {{"maps", options_.max_maps},
                    {"memory_bytes", options_.max_memory_bytes},
                    {"rest_after_s", store_ ? options_.rest_after.count() : 0}}},
                  {"damaged", std::move(damaged)},
                  {"damaged_files", damaged_.size()},
                  {"unloaded", first_of(unloaded_, [](const UnloadedMap& map) { return describe(map); })},
                  {"unloaded_maps", unloaded_.size()},
                  {"clients", std::move(clients)},
                  {"wearers", std::move(wearers)}}));
}

json MapService::describe_map(MapId id, const MapEntry& entry) const {
  json map = describe(id, entry);
  const auto corner = [](const Eigen::Vector3f& at) { return json{at.x(), at.y(), at.z()}; };
  map["bounds"] = {{"min", corner(entry.statistics.bounds_min)},
                   {"max", corner(entry.statistics.bounds_max)}};
  map["clients"] = count_in(id);
  if (entry.localized_at) map["localized"] = to_utc(*entry.localized_at);
  map["offers_accepted"] = entry.offer_times.accepted();
  if (const auto wait = entry.offer_times.wait_ms(0.5)) map["offer_p50_ms"] = *wait;
  if (const auto wait = entry.offer_times.wait_ms(0.95)) map["offer_p95_ms"] = *wait;
  json& overlaps = map["overlaps"] = json::array();
  for (const OverlapList::Neighbour& neighbour : overlaps_.of(id)) {
    const auto known = maps_.all().find(neighbour.map);
    if (known == maps_.all().end() || known->second.snapshot == nullptr) continue;  // deleted
    if (overlaps.size() < kMostOverlapsTold) overlaps.push_back(describe(neighbour, known->second.name));
  }
  return map;
}

void MapService::list_maps(const PageBegin& begin, const AdminAnswer& answer) {
  ReplyPage page{"maps", "deleted", "damaged", "unloaded"};
  std::set<MapId> served;
  bool has_room = true;
  for (const auto& [id, entry] : maps_.all()) {
    if (entry.snapshot == nullptr) continue;
    served.insert(id);
    has_room = has_room && (to_hex(id.bytes) <= begin.after || page.add("maps", describe_map(id, entry)));
  }
  if (store_ == nullptr || page.content()["more"]) return answer(success(page.content()));
  with_store(answer,
             [this, answer, begin, served, page = std::move(page)](const Store& store) mutable -> Task {
               const std::vector<DamagedFile> damaged = store.damaged_files();
               const std::vector<UnloadedMap> unloaded = store_->unloaded();
               add_from(begin.deleted_from, store.deleted_maps(), "deleted", &page,
                        [](const DeletedMap& map) { return describe(map); });
               add_from(begin.damaged_from, damaged, "damaged", &page,
                        [&](const DamagedFile& file) { return describe(file, served.contains(file.map)); });
               add_from(begin.unloaded_from, unloaded, "unloaded", &page,
                        [](const UnloadedMap& map) { return describe(map); });
               return [this, answer, damaged, unloaded, page = std::move(page)] {
                 damaged_ = damaged;
                 unloaded_ = unloaded;
                 answer(success(page.content()));
               };
             });
}

void MapService::look_for_damage() {
  store_->run_beside([this](const Store& store) {
    post_([this, damaged = store.damaged_files(), unloaded = store_->unloaded()] {
      damaged_ = damaged;
      unloaded_ = unloaded;
    });
  });
}

void MapService::show_map(MapId id, const MapEntry& entry, const AdminAnswer& answer) {
  json map = describe_map(id, entry);
  map["labels"] = entry.labels.all().size();
  if (entry.runner == nullptr) return answer(success(map));
  entry.runner->measure([this, map = std::move(map), answer](const MapMeasures& measures) {
    post_([map, answer, measures]() mutable {
      map["reprojection_px"] = measures.reprojection_rms;
      map["cameras"] = describe(measures.cameras);
      answer(success(map));
    });
  });
}

void MapService::edit_label(const MapEntry& entry, const wire::ClientRequest& wish, const Principal& who,
                            const AdminAnswer& answer) {
  const std::string which = "label " + std::to_string(wish.label.value) + " of map '" + entry.name + "'";
  const std::optional<Label> before = entry.labels.find(wish.label);
  if (!before) {
    return answer(refusal(ErrorCode::kNotFound,
                          "there is no " + which + "; `cairnctl labels " + entry.name + "` lists them"));
  }
  if (entry.labels.is_busy(wish.label))
    return answer(refusal(ErrorCode::kRefused, which + " is being changed by another; try again"));
  const auto done = [name = entry.name, which, before = *before,
                     answer](const LabelBook::Judgement& judgement) {
    if (judgement.decision != wire::RequestDecision::kDone) {
      return answer(refusal(error_of(judgement.decision), which + ": " + judgement.reason));
    }
    answer(success(describe(name, judgement.changed ? label_of(*judgement.changed) : before)));
  };
  change_label(wish, who, std::nullopt, done);
}

}  // namespace cairn
