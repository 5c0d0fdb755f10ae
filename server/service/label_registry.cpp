// SPDX-License-Identifier: Apache-2.0
#include "server/service/label_registry.h"

#include <algorithm>
#include <utility>

#include "common/base/utf8.h"

namespace cairn {
namespace {

using wire::RequestAction;
using wire::RequestDecision;

constexpr double kNoticeableAngle = 4e-4;  ///< [rad] 0.2 px of a camera with f = 500 px
constexpr double kNoticeableTurn = 0.01;   ///< [rad] of the label about itself
/// [map unit] From the origin, along each axis. The wire and files end farther out, so that a label may move
/// with its map.
constexpr double kFarthest = 1e5;

LabelRegistry::Judgement refusal(RequestDecision decision, std::string reason, LabelId label = {}) {
  return {decision, std::move(reason), label, {}};
}

bool noticeably_differ(const SE3& told, const SE3& now, const KeyframePose& seen_from) {
  const double distance = (now.translation() - seen_from.camera_from_map.center()).norm();
  return (now.translation() - told.translation()).norm() > kNoticeableAngle * distance ||
         now.rotation().angularDistance(told.rotation()) > kNoticeableTurn;
}

/// Moves a label with its keyframe. Returns the keyframe; null if it is not there any more.
const KeyframePose* ride(const MapSnapshot& map, LabelRecord* label) {
  const KeyframePose* keyframe = map.find(label->anchor);
  if (keyframe != nullptr)
    label->map_from_label = keyframe->camera_from_map.inverse() * label->anchor_from_label;
  return keyframe;
}

/// Anchors a label at the keyframe that is nearest. False for a map without any.
bool anchor(const MapSnapshot& map, LabelRecord* label) {
  const KeyframePose* nearest = map.nearest_keyframe(label->map_from_label.translation());
  if (nearest == nullptr) return false;
  label->anchor = nearest->id;
  label->anchor_from_label = nearest->camera_from_map * label->map_from_label;
  return true;
}

}  // namespace

Label label_of(const LabelRecord& record) {
  return {{record.id}, record.kind, record.text, record.map_from_label, record.author, record.time};
}

void LabelRegistry::restore(const std::vector<LabelRecord>& records, LabelId last_given) {
  last_id_ = std::max(last_id_, last_given.value);
  for (const LabelRecord& record : records) {
    labels_.insert_or_assign(LabelId{record.id}, Entry{record, record.map_from_label});
    last_id_ = std::max(last_id_, record.id);
  }
}

LabelRegistry::Judgement LabelRegistry::judge(const wire::ClientRequest& request, const std::string& author,
                                              Timestamp now, const MapSnapshot& map) {
  const bool has_text = request.action != RequestAction::kRemoveLabel;
  if (has_text && is_invisible(request.text))
    return refusal(RequestDecision::kUnfit, "a label needs a text", request.label);
  if (has_text && request.text.size() > kMaxLabelBytes)
    return refusal(RequestDecision::kUnfit, "the text is too long", request.label);
  if (const auto fault = has_text ? fault_of_text(request.text) : std::nullopt)
    return refusal(RequestDecision::kUnfit, "a label is one line of UTF-8: " + *fault, request.label);
  if (request.action == RequestAction::kAddLabel) return judge_new(request, author, now, map);
  const auto found = labels_.find(request.label);
  if (found == labels_.end())
    return refusal(RequestDecision::kUnknownLabel, "there is no such label", request.label);
  Judgement done{RequestDecision::kDone, {}, request.label, {}};
  if (request.action == RequestAction::kRenameLabel) {
    done.changed = found->second.record;
    done.changed->text = request.text;
    done.changed->author = author;
    done.changed->time = now;
  }
  busy_.insert(request.label);
  return done;
}

LabelRegistry::Judgement LabelRegistry::judge_new(const wire::ClientRequest& request,
                                                  const std::string& author, Timestamp now,
                                                  const MapSnapshot& map) {
  if (labels_.size() + busy_.size() >= kMaxLabels) {
    return refusal(RequestDecision::kFull,
                   "the map has " + std::to_string(kMaxLabels) + " labels, which is all it may have");
  }
  const KeyframePose* keyframe = request.epoch == map.epoch ? map.find(request.reference) : nullptr;
  if (keyframe == nullptr) {
    return refusal(RequestDecision::kStale,
                   "the map has changed since the place was pointed at; point at it again");
  }
  LabelRecord label;
  label.text = request.text;
  label.map_from_label = keyframe->camera_from_map.inverse() * request.reference_from_label;
  const auto& place = label.map_from_label.translation();
  if (!(place.cwiseAbs().maxCoeff() <= kFarthest))
    return refusal(RequestDecision::kUnfit, "the place is too far away for a label");
  label.id = ++last_id_;
  label.author = author;
  label.time = now;
  label.kind = request.kind;
  label.anchor = keyframe->id;
  label.anchor_from_label = request.reference_from_label;
  const LabelId id{label.id};
  busy_.insert(id);
  return {RequestDecision::kDone, {}, id, std::move(label)};
}

void LabelRegistry::settle(const Judgement& judgement, bool kept, const MapSnapshot& map) {
  busy_.erase(judgement.label);
  if (!kept) return;
  if (!judgement.changed) {
    labels_.erase(judgement.label);
    return;
  }
  LabelRecord label = *judgement.changed;
  (void)ride(map, &label);  // the map may have moved while the label was being kept
  labels_.insert_or_assign(judgement.label, Entry{label, label.map_from_label});
}

LabelRegistry::Moves LabelRegistry::follow(const MapSnapshot& map) {
  Moves moves;
  for (auto& [id, entry] : labels_) {
    LabelRecord& label = entry.record;
    const KeyframePose* keyframe = ride(map, &label);
    if (keyframe == nullptr && anchor(map, &label)) {
      moves.anchored.push_back(label);
      keyframe = map.find(label.anchor);
    }
    if (keyframe != nullptr && noticeably_differ(entry.told, label.map_from_label, *keyframe)) {
      entry.told = label.map_from_label;
      moves.moved.push_back(id);
    }
  }
  return moves;
}

std::optional<Label> LabelRegistry::find(LabelId label) const {
  const auto found = labels_.find(label);
  if (found == labels_.end()) return std::nullopt;
  return label_of(found->second.record);
}

std::vector<Label> LabelRegistry::all() const {
  std::vector<Label> labels;
  for (const auto& [id, entry] : labels_) labels.push_back(label_of(entry.record));
  return labels;
}

}  // namespace cairn
