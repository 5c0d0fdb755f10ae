// SPDX-License-Identifier: Apache-2.0
#include "server/service/label_administration.h"

#include <optional>

namespace cairn {
namespace {

/// What it is to an operator that a label is not changed.
ErrorCode error_of(wire::RequestDecision decision) {
  if (decision == wire::RequestDecision::kUnfit) return ErrorCode::kUsage;
  // No label is added here: nothing is full but the disk.
  return decision == wire::RequestDecision::kFull ? ErrorCode::kIo : ErrorCode::kRefused;
}

wire::ClientRequest wish_of(wire::RequestAction action, MapId map, LabelId label) {
  wire::ClientRequest wish;
  wish.action = action;
  wish.map = map;
  wish.label = label;
  return wish;
}

}  // namespace

void LabelAdministration::take(const Principal&, MapId, const MapEntry& entry, const asked::Labels& ask,
                               const AdminAnswer& answer) const {
  told::Labels page;
  for (Label& label : entry.labels.all())
    if (label.id > ask.after) page.labels.push_back({entry.name, std::move(label)});
  answer(std::move(page));
}

void LabelAdministration::take(const Principal& who, MapId id, const MapEntry& entry,
                               const asked::RenameLabel& ask, const AdminAnswer& answer) {
  wire::ClientRequest wish = wish_of(wire::RequestAction::kRenameLabel, id, ask.label);
  wish.text = ask.text;
  edit(who, entry, wish, answer);
}

void LabelAdministration::take(const Principal& who, MapId id, const MapEntry& entry,
                               const asked::RemoveLabel& ask, const AdminAnswer& answer) {
  edit(who, entry, wish_of(wire::RequestAction::kRemoveLabel, id, ask.label), answer);
}

void LabelAdministration::edit(const Principal& who, const MapEntry& entry, const wire::ClientRequest& wish,
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
                     answer](const LabelRegistry::Judgement& judgement) {
    if (judgement.decision != wire::RequestDecision::kDone)
      return answer(refusal(error_of(judgement.decision), which + ": " + judgement.reason));
    answer(told::LabelSeen{name, judgement.changed ? label_of(*judgement.changed) : before});
  };
  labels_.change(wish, who, std::nullopt, done);
}

}  // namespace cairn
