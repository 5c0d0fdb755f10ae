// SPDX-License-Identifier: Apache-2.0
#include "server/service/labels.h"

#include <utility>

namespace cairn {
namespace {

/// Why it is not allowed; empty when it is. Who may only add may also change what is his own.
std::string why_not_allowed(const Ruling& ruling, const wire::ClientRequest& request, const Principal& author,
                            const LabelRegistry& labels) {
  if (ruling.right < Right::kAdd) return ruling.reason;
  if (ruling.right >= Right::kWrite || request.action == wire::RequestAction::kAddLabel) return {};
  const std::optional<Label> label = labels.find(request.label);
  return !label || label->author == author.name ? std::string() : ruling.reason;
}

/// Position in the map of the label that a request is about, as it is or is to be. Nothing if it cannot be
/// told: LabelRegistry::judge() refuses the request for that.
std::optional<Eigen::Vector3d> place_of(const wire::ClientRequest& request, const MapEntry& entry) {
  if (request.action != wire::RequestAction::kAddLabel) {
    const std::optional<Label> label = entry.labels.find(request.label);
    return label ? std::optional<Eigen::Vector3d>(label->map_from_label.translation()) : std::nullopt;
  }
  const KeyframePose* reference = entry.snapshot->find(request.reference);
  if (reference == nullptr || request.epoch != entry.snapshot->epoch) return std::nullopt;
  return reference->camera_from_map.inverse() * request.reference_from_label.translation();
}

/// Why the label may not be there; empty: it may.
std::string why_outside(const Ruling& ruling, const wire::ClientRequest& request, const MapEntry& entry) {
  if (!ruling.extent) return {};
  const auto place = place_of(request, entry);
  return !place || contains(*ruling.extent, *place) ? std::string()
                                                    : outside(*ruling.extent, "the label", *place);
}

/// Name of a request's action in the audit log.
std::string action_of(wire::RequestAction action) {
  if (action == wire::RequestAction::kAddLabel) return "label place";
  return action == wire::RequestAction::kRenameLabel ? "label rename" : "label remove";
}

/// An operator has been asked about as such.
Ruling ruling_on_labels(const AccessPolicy& access, const Principal& author, MapId map) {
  if (author.kind == Principal::Kind::kOperator) return {Right::kManage, {}, {}, {}};
  return access.in_map(author, map);
}

}  // namespace

void Labels::take(const Principal& who, const wire::ClientRequest& request) {
  Client& client = clients_.of(who);
  if (!sessions_.holds(client, request.command.session)) return;  // it will be sent again
  const auto rate = client.rates.judge(ClientRates::Kind::kRequest, context_.now());
  if (rate == ClientRates::Judgement::kPassOver) return;
  const MapEntry* entry = maps_.array().find(request.map);
  if (entry != nullptr && entry->labels.is_busy(request.label)) return;
  const auto refuse_for_now = [&](std::string why) {
    on_decided(client.name, request, {wire::RequestDecision::kBusy, std::move(why), request.label, {}});
  };
  switch (client.request_gate.admit(request.command.seq)) {
    case RequestGate::Admission::kNew:
      break;
    case RequestGate::Admission::kNoCredit:
      return refuse_for_now("more requests under way than the credit allows");
    case RequestGate::Admission::kRepeated:
      return clients_.write_verdicts(client);
    case RequestGate::Admission::kInFlight:
    case RequestGate::Admission::kGap:
      return;
  }
  if (rate == ClientRates::Judgement::kRefuse)
    return refuse_for_now(client.rates.why(ClientRates::Kind::kRequest));
  DecisionRecord decision;
  decision.client = client.name;
  decision.session = request.command.session;
  decision.seq = request.command.seq;
  decision.kind = CommandKind::kRequest;
  const std::optional<Label> before = entry == nullptr ? std::nullopt : entry->labels.find(request.label);
  change(request, client.principal(), std::move(decision),
         [this, name = client.name, request,
          old_text = before ? before->text : std::string()](const LabelRegistry::Judgement& judgement) {
           note(name, request, judgement, old_text);
           on_decided(name, request, judgement);
         });
}

void Labels::note(const std::string& client_name, const wire::ClientRequest& request,
                  const LabelRegistry::Judgement& judgement, const std::string& old_text) {
  const MapEntry* entry = maps_.array().find(request.map);
  const std::string map = "map " + (entry == nullptr ? to_hex(request.map.bytes) : entry->name);
  if (judgement.decision == wire::RequestDecision::kDone) {
    const std::string text = judgement.changed ? label_of(*judgement.changed).text : old_text;
    const std::string label = ", label " + std::to_string(judgement.label.value) + ", text " + text;
    return clients_.note_done(client_name, action_of(request.action), map + label);
  }
  Client* client = clients_.find(client_name);
  if (client == nullptr) return;
  if (judgement.decision == wire::RequestDecision::kNoRight)
    return clients_.note_refused(*client, action_of(request.action), map, judgement.reason);
  // It is not told that there is such a map.
  const Ruling ruling = ruling_on_labels(context_.access(), client->principal(), request.map);
  if (entry != nullptr && ruling.right == Right::kNone)
    clients_.note_refused(*client, action_of(request.action), map, ruling.reason);
}

void Labels::on_decided(const std::string& client_name, const wire::ClientRequest& request,
                        const LabelRegistry::Judgement& judgement) {
  context_.log->debug("{}: request {}: label {} {}", client_name, request.command.seq, judgement.label.value,
                      judgement.reason);
  Client* client = clients_.find(client_name);
  if (client == nullptr) return;
  client->request_gate.decide(request.command.session, {request.command.seq, judgement.decision,
                                                        judgement.reason, request.map, judgement.label});
  clients_.write_verdicts(*client);
}

std::optional<LabelRegistry::Judgement> Labels::refuse(const wire::ClientRequest& request,
                                                       const Principal& author, const MapEntry* entry) const {
  const auto because = [&](wire::RequestDecision decision, std::string why) {
    return LabelRegistry::Judgement{decision, std::move(why), request.label, {}};
  };
  const Ruling ruling = ruling_on_labels(context_.access(), author, request.map);
  if (entry == nullptr || entry->snapshot == nullptr || ruling.right == Right::kNone)
    return because(wire::RequestDecision::kUnknownMap, "this server does not know the map");
  if (std::string why = why_not_allowed(ruling, request, author, entry->labels); !why.empty())
    return because(wire::RequestDecision::kNoRight, std::move(why));
  if (std::string why = why_outside(ruling, request, *entry); !why.empty())
    return because(wire::RequestDecision::kNoRight, std::move(why));
  if (entry->rolling_back) return because(wire::RequestDecision::kBusy, kRollingBack);
  const size_t labels = entry->labels.all().size();
  if (request.action == wire::RequestAction::kAddLabel && labels >= context_.options.max_labels) {
    return because(wire::RequestDecision::kFull, "the map has " + std::to_string(labels) +
                                                     " labels, which is all it may have (--max-labels)");
  }
  if (entry->runner == nullptr) return because(wire::RequestDecision::kNoRight, "this map takes no labels");
  return std::nullopt;
}

void Labels::change(const wire::ClientRequest& request, const Principal& author,
                    std::optional<DecisionRecord> decision, const Done& done) {
  MapEntry* entry = maps_.array().find(request.map);
  if (const auto refused = refuse(request, author, entry)) return done(*refused);
  const LabelRegistry::Judgement judged =
      entry->labels.judge(request, author.name, context_.wall(), *entry->snapshot);
  if (judged.decision != wire::RequestDecision::kDone) return done(judged);
  maps_.young().forget(request.map);
  const auto settle = [this, map = request.map, judged, done](const Status& kept) {
    LabelRegistry::Judgement word = judged;
    if (!kept) {
      word.decision = wire::RequestDecision::kFull;
      word.reason = kept.error().message;
    }
    if (MapEntry* changed = maps_.array().find(map); changed != nullptr && changed->snapshot != nullptr) {
      changed->labels.settle(judged, kept.has_value(), *changed->snapshot);
      if (kept) tell(map, *changed, judged.label);
    }
    done(word);
  };
  if (context_.store == nullptr) return settle({});
  keep(request.map, judged, std::move(decision), settle);
}

void Labels::keep(MapId map, const LabelRegistry::Judgement& judged, std::optional<DecisionRecord> decision,
                  std::function<void(const Status& kept)> settle) {
  MapUpdate update;
  if (judged.changed) {
    update.labels.push_back(*judged.changed);
  } else {
    update.removed_labels.push_back(judged.label.value);
  }
  if (decision) {
    decision->decision = static_cast<uint8_t>(judged.decision);
    decision->label = judged.label.value;
    decision->time = context_.wall();
    update.decisions.push_back(std::move(*decision));
  }
  context_.store->write(map, std::move(update), [this, settle = std::move(settle)](const Status& kept) {
    context_.post([settle, kept] { settle(kept); });
  });
}

void Labels::tell(MapId map, const MapEntry& entry, LabelId id) {
  const std::optional<Label> label = entry.labels.find(id);
  if (label) {
    context_.output.labelled({map, entry.snapshot->epoch, *label});
  } else {
    context_.output.label_removed(map, id);
  }
}

void Labels::follow(MapId map, MapEntry& entry) {
  LabelRegistry::Moves moves = entry.labels.follow(*entry.snapshot);
  for (const LabelId label : moves.moved) tell(map, entry, label);
  if (moves.anchored.empty() || context_.store == nullptr || entry.rolling_back) return;
  MapUpdate update;
  update.labels = std::move(moves.anchored);
  context_.store->write(map, std::move(update), {});  // if it fails, the pose kept with the label serves
}

}  // namespace cairn
