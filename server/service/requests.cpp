// SPDX-License-Identifier: Apache-2.0
#include <utility>

#include "server/service/map_service.h"

/// Labels: what people ask for, on its way to the store and to all who read the map.
namespace cairn {
namespace {

/// Why it is not allowed; empty when it is. Who may only add may also change what is his own.
std::string why_not(const Ruling& ruling, const wire::ClientRequest& request, const Principal& author,
                    const LabelBook& labels) {
  if (ruling.right < Right::kAdd) return ruling.reason;
  if (ruling.right >= Right::kWrite || request.action == wire::RequestAction::kAddLabel) return {};
  const std::optional<Label> label = labels.find(request.label);
  return !label || label->author == author.name ? std::string() : ruling.reason;
}

}  // namespace

/// An operator has been asked about as such.
Ruling MapService::ruling_on_labels(const Principal& author, MapId map) const {
  if (author.kind == Principal::Kind::kOperator) return {Right::kManage, {}, {}, {}};
  return options_.access->in_map(author, map);
}

void MapService::take(const Principal& who, const wire::ClientRequest& request) {
  Client& client = client_of(who);
  if (!presence_.holds(client.name, request.command.session)) return;  // it will be sent again
  const auto rate = client.rates.judge(ClientRates::Kind::kRequest, clock_.now());
  if (rate == ClientRates::Judgement::kPassOver) return;
  const MapEntry* entry = maps_.find(request.map);
  if (entry != nullptr && entry->labels.is_busy(request.label)) return;
  switch (client.request_gate.admit(request.command.seq)) {
    case RequestGate::Admission::kNew:
      break;
    case RequestGate::Admission::kNoCredit:
      return on_request_decided(client.name, request,
                                {wire::RequestDecision::kBusy,
                                 "more requests under way than the credit allows",
                                 request.label,
                                 {}});
    case RequestGate::Admission::kRepeated:
      return write_verdicts(client);
    case RequestGate::Admission::kInFlight:
    case RequestGate::Admission::kGap:
      return;
  }
  if (rate == ClientRates::Judgement::kRefuse) {
    return on_request_decided(
        client.name, request,
        {wire::RequestDecision::kBusy, client.rates.why(ClientRates::Kind::kRequest), request.label, {}});
  }
  DecisionRecord decision;
  decision.client = client.name;
  decision.session = request.command.session;
  decision.seq = request.command.seq;
  decision.kind = CommandKind::kRequest;
  change_label(request, client.principal(), std::move(decision),
               [this, name = client.name, request](const LabelBook::Judgement& judgement) {
                 on_request_decided(name, request, judgement);
               });
}

void MapService::on_request_decided(const std::string& client_name, const wire::ClientRequest& request,
                                    const LabelBook::Judgement& judgement) {
  log_->debug("{}: request {}: label {} {}", client_name, request.command.seq, judgement.label.value,
              judgement.reason);
  const auto client = clients_.find(client_name);
  if (client == clients_.end()) return;
  client->second.request_gate.decide(
      request.command.session,
      {request.command.seq, judgement.decision, judgement.reason, request.map, judgement.label});
  write_verdicts(client->second);
}

void MapService::change_label(const wire::ClientRequest& request, const Principal& author,
                              std::optional<DecisionRecord> decision, const LabelDone& done) {
  MapEntry* entry = maps_.find(request.map);
  const Ruling ruling = ruling_on_labels(author, request.map);
  if (entry == nullptr || entry->snapshot == nullptr || ruling.right == Right::kNone)
    return done({wire::RequestDecision::kUnknownMap, "this server does not know the map", request.label, {}});
  if (std::string why = why_not(ruling, request, author, entry->labels); !why.empty())
    return done({wire::RequestDecision::kNoRight, std::move(why), request.label, {}});
  if (entry->rolling_back) return done({wire::RequestDecision::kBusy, kRollingBack, request.label, {}});
  const size_t labels = entry->labels.all().size();
  if (request.action == wire::RequestAction::kAddLabel && labels >= options_.max_labels) {
    return done({wire::RequestDecision::kFull,
                 "the map has " + std::to_string(labels) + " labels, which is all it may have (--max-labels)",
                 request.label,
                 {}});
  }
  if (entry->runner == nullptr)
    return done({wire::RequestDecision::kNoRight, "this map takes no labels", request.label, {}});
  const Timestamp now = clock_.wall();
  const LabelBook::Judgement judged = entry->labels.judge(request, author.name, now, *entry->snapshot);
  if (judged.decision != wire::RequestDecision::kDone) return done(judged);
  young_.forget(request.map);
  const auto settle = [this, map = request.map, judged, done](const Status& kept) {
    LabelBook::Judgement word = judged;
    if (!kept) {
      word.decision = wire::RequestDecision::kFull;
      word.reason = kept.error().message;
    }
    if (MapEntry* changed = maps_.find(map); changed != nullptr && changed->snapshot != nullptr) {
      changed->labels.settle(judged, kept.has_value(), *changed->snapshot);
      if (kept) tell_label(map, *changed, judged.label);
    }
    done(word);
  };
  if (store_ == nullptr) return settle({});

  MapUpdate update;
  if (judged.changed) {
    update.labels.push_back(*judged.changed);
  } else {
    update.removed_labels.push_back(judged.label.value);
  }
  if (decision) {
    decision->decision = static_cast<uint8_t>(judged.decision);
    decision->label = judged.label.value;
    decision->time = now;
    update.decisions.push_back(std::move(*decision));
  }
  store_->write(request.map, std::move(update),
                [this, settle](const Status& kept) { post_([settle, kept] { settle(kept); }); });
}

void MapService::tell_label(MapId map, const MapEntry& entry, LabelId id) {
  const std::optional<Label> label = entry.labels.find(id);
  if (label) {
    output_.labelled({map, entry.snapshot->epoch, *label});
  } else {
    output_.label_removed(map, id);
  }
}

void MapService::move_labels(MapId map, MapEntry& entry) {
  LabelBook::Moves moves = entry.labels.follow(*entry.snapshot);
  for (const LabelId label : moves.moved) tell_label(map, entry, label);
  if (moves.anchored.empty() || store_ == nullptr || entry.rolling_back) return;
  MapUpdate update;
  update.labels = std::move(moves.anchored);
  store_->write(map, std::move(update), {});  // if it fails, the pose that was kept with the label serves
}

}  // namespace cairn
