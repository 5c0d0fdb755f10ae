// SPDX-License-Identifier: Apache-2.0
#include <chrono>
#include <utility>

#include "server/service/switchboard.h"

/// Labels: what people ask for, on its way to the store and to all who read the map.
namespace cairn {
namespace {

Timestamp wall_time() {
  return {std::chrono::duration_cast<std::chrono::nanoseconds>(
              std::chrono::system_clock::now().time_since_epoch())
              .count()};
}

DecisionRecord record_of(const std::string& client, wire::CommandId command,
                         const LabelBook::Judgement& judgement, Timestamp time) {
  DecisionRecord record;
  record.client = client;
  record.session = command.session;
  record.seq = command.seq;
  record.kind = CommandKind::kRequest;
  record.decision = static_cast<uint8_t>(judgement.decision);
  record.reason = judgement.reason;
  record.time = time;
  record.label = judgement.label.value;
  return record;
}

}  // namespace

void Switchboard::on_request(Client& client, const wire::ClientRequest& request) {
  if (!presence_.holds(client.name, request.command.session)) return;  // it will be sent again
  MapEntry* entry = maps_.find(request.map);
  if (entry != nullptr && entry->labels.is_busy(request.label)) return;
  const auto refuse = [&](wire::RequestDecision decision, std::string reason) {
    on_request_decided(client.name, request, {decision, std::move(reason), request.label, {}});
  };
  switch (client.request_gate.admit(request.command.seq)) {
    case RequestGate::Admission::kNew:
      break;
    case RequestGate::Admission::kNoCredit:
      return refuse(wire::RequestDecision::kBusy, "more requests under way than the credit allows");
    case RequestGate::Admission::kRepeated:
      return write_verdicts(client);
    case RequestGate::Admission::kInFlight:
    case RequestGate::Admission::kGap:
      return;
  }
  if (entry == nullptr || entry->snapshot == nullptr)
    return refuse(wire::RequestDecision::kUnknownMap, "this server does not know the map");
  if (entry->runner == nullptr) return refuse(wire::RequestDecision::kNoRight, "this map takes no labels");
  const Timestamp now = wall_time();
  LabelBook::Judgement judged = entry->labels.judge(request, client.name, now, *entry->snapshot);
  if (judged.decision != wire::RequestDecision::kDone || store_ == nullptr)
    return on_request_decided(client.name, request, std::move(judged));

  MapUpdate update;
  update.decisions.push_back(record_of(client.name, request.command, judged, now));
  if (judged.changed) {
    update.labels.push_back(*judged.changed);
  } else {
    update.removed_labels.push_back(judged.label.value);
  }
  store_->write(request.map, std::move(update),
                [this, name = client.name, request, judged = std::move(judged)](const Status& kept) {
                  LabelBook::Judgement word = judged;
                  if (!kept) {
                    word.decision = wire::RequestDecision::kFull;
                    word.reason = kept.error().message;
                  }
                  post([this, name, request, word = std::move(word)]() mutable {
                    on_request_decided(name, request, std::move(word));
                  });
                });
}

void Switchboard::on_request_decided(const std::string& client_name, const wire::ClientRequest& request,
                                     LabelBook::Judgement judgement) {
  const bool done = judgement.decision == wire::RequestDecision::kDone;
  MapEntry* entry = maps_.find(request.map);
  if (entry != nullptr && entry->snapshot != nullptr && entry->labels.is_busy(judgement.label)) {
    entry->labels.settle(judgement, done, *entry->snapshot);
    if (done) tell_label(request.map, *entry, judgement.label);
  }
  log_->debug("{}: request {}: label {}{}", client_name, request.command.seq, judgement.label.value,
              done ? "" : ": " + judgement.reason);
  const auto client = clients_.find(client_name);
  if (client == clients_.end()) return;
  client->second.request_gate.decide(
      request.command.session,
      {request.command.seq, judgement.decision, std::move(judgement.reason), request.map, judgement.label});
  write_verdicts(client->second);
}

void Switchboard::tell_label(MapId map, const MapEntry& entry, LabelId id) {
  const std::optional<Label> label = entry.labels.find(id);
  for (auto& [name, client] : clients_) {
    const auto feed = client.feeds.find(map);
    if (feed == client.feeds.end()) continue;
    report(label ? feed->second.show({map, entry.snapshot->epoch, *label}) : feed->second.hide(map, id),
           "Label");
  }
}

void Switchboard::move_labels(MapId map, MapEntry& entry) {
  LabelBook::Moves moves = entry.labels.follow(*entry.snapshot);
  for (const LabelId label : moves.moved) tell_label(map, entry, label);
  if (moves.anchored.empty() || store_ == nullptr) return;
  MapUpdate update;
  update.labels = std::move(moves.anchored);
  store_->write(map, std::move(update), {});  // if it fails, the pose that was kept with the label serves
}

}  // namespace cairn
