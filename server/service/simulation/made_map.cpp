// SPDX-License-Identifier: Apache-2.0
#include "server/service/simulation/made_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "server/store/map_file.h"

namespace cairn::simulation {
namespace {

constexpr const char* kBefore = "before-rollback-";  ///< what a roll-back tags first

std::set<KeyframeId> shown_by(const MapSnapshot& map) {
  std::set<KeyframeId> ids;
  for (const auto& block : map.keyframe_blocks) {
    for (size_t slot = 0; slot < block->keyframes.size(); ++slot)
      if ((block->live >> slot & 1) != 0) ids.insert(block->keyframes[slot].id);
  }
  return ids;
}

}  // namespace

bool MadeMap::accept(KeyframeId keyframe, Timestamp image, Moment arrived) {
  arrived_.try_emplace(image, arrived);
  // It may have been accepted before the roll-back, and told now: then it may have gone with it.
  if (arrived < rolled_back_at_) return true;
  return keyframes_.try_emplace(keyframe, image).first->second == image;
}

bool MadeMap::label(LabelId label, const std::string& text, Moment arrived) {
  if (arrived < rolled_back_at_) return true;
  return labels_.try_emplace(label, text).first->second == text;
}

void MadeMap::tag(const std::string& name, std::set<KeyframeId> shown, Moment now) {
  Tagged tagged = asked_;
  tagged.shown = std::move(shown);
  tagged.told = now;
  tags_.emplace(name, std::move(tagged));
}

std::set<std::string> MadeMap::tags() const {
  std::set<std::string> names;
  for (const auto& [name, tagged] : tags_) names.insert(name);
  return names;
}

void MadeMap::ask_to_roll_back(const std::string& tag, Epoch now) {
  was_rolled_back = true;
  rolling_back_ = RollingBack{tag, now};
}

void MadeMap::become(const Tagged& tag, Moment now) {
  keyframes_ = tag.keyframes;
  labels_ = tag.labels;
  proposed_ = tag.proposed;
  gone_.clear();
  for (const auto& [image, arrived] : arrived_)
    if (arrived > tag.told) gone_.insert(image);
  ++roll_backs_;
  rolled_back_at_ = now;
}

std::optional<std::string> MadeMap::roll_back(const MapSnapshot& newest, Moment now) {
  const RollingBack done = *std::exchange(rolling_back_, std::nullopt);
  const Tagged& tag = tags_.at(done.tag);
  become(tag, now);
  if (newest.epoch <= done.from) return "is rolled back in the same epoch";
  const std::set<KeyframeId> shown = shown_by(newest);
  for (const auto& [keyframe, image] : tag.keyframes) {
    if (!shown.contains(keyframe))
      return fmt::format("is rolled back and does not show keyframe {} of the tag", keyframe.value);
  }
  for (const KeyframeId keyframe : shown) {
    if (!tag.shown.contains(keyframe))
      return fmt::format("is rolled back and shows keyframe {}, which came after the tag", keyframe.value);
  }
  return std::nullopt;
}

MadeMap MadeMap::copy() const {
  MadeMap copied;
  copied.keyframes_ = keyframes_;
  copied.labels_ = labels_;
  copied.proposed_ = proposed_;
  copied.arrived_ = arrived_;
  copied.texts = texts;
  copied.maybe_removed = maybe_removed;
  // Of labels that were removed before, a copy knows nothing: it may give their numbers again.
  std::erase_if(copied.labels_, [this](const auto& label) { return maybe_removed.contains(label.first); });
  return copied;
}

void MadeMap::check_kept(const std::filesystem::path& path, Moment now, const Tell& violated) {
  auto file = MapFile::open(path);
  if (!file) return violated(file.error().message);
  const auto tags = file->tags();
  if (!tags) return violated(tags.error().message);
  const auto made = std::count_if(tags->begin(), tags->end(),
                                  [](const MapTag& tag) { return tag.name.starts_with(kBefore); });
  const auto roll_backs = static_cast<size_t>(made);
  if (roll_backs > roll_backs_ && rolling_back_) become(tags_.at(rolling_back_->tag), now);
  if (roll_backs != roll_backs_)
    violated(fmt::format("was rolled back {} times, and {} are known of", roll_backs, roll_backs_));
  for (const auto& [name, tagged] : tags_) {
    const bool is_kept = std::any_of(tags->begin(), tags->end(),
                                     [&wanted = name](const MapTag& tag) { return tag.name == wanted; });
    if (!is_kept) violated("tag " + name + " is not kept");
  }
  check_rows(path, violated);
}

void MadeMap::check_copied(const std::filesystem::path& file, const Tell& violated) const {
  check_rows(file, violated);
}

void MadeMap::check_rows(const std::filesystem::path& path, const Tell& violated) const {
  auto file = MapFile::open(path);
  if (!file) return violated(file.error().message);
  const StoredMap stored = file->load();
  for (const std::string& damage : stored.damage) violated(damage);
  std::map<KeyframeId, Timestamp> kept;
  std::map<Timestamp, KeyframeId> by_time;
  for (const KeyframeRecord& keyframe : stored.record.keyframes) {
    kept[keyframe.id] = keyframe.time;
    const auto [known, is_new] = by_time.emplace(keyframe.time, keyframe.id);
    if (!is_new)
      violated(
          fmt::format("keyframes {} and {} are of the same image", known->second.value, keyframe.id.value));
    if (gone_.contains(keyframe.time))
      violated(fmt::format("keyframe {} came after the tag that the map was rolled back to, and is kept",
                           keyframe.id.value));
  }
  for (const auto& [keyframe, time] : keyframes_) {
    const auto found = kept.find(keyframe);
    if (found == kept.end() || found->second != time)
      violated(fmt::format("keyframe {} was accepted and is {}", keyframe.value,
                           found == kept.end() ? "not kept" : "another"));
  }
  for (const KeyframeId keyframe : proposed_) {
    if (!kept.contains(keyframe))
      violated(fmt::format("keyframe {} was an accepted proposal and is not kept", keyframe.value));
  }
  std::map<LabelId, std::string> labels;
  for (const LabelRecord& label : stored.labels) labels[LabelId{label.id}] = label.text;
  for (const auto& [label, text] : labels_) {
    const auto found = labels.find(label);
    const bool may_be_gone = maybe_removed.contains(label);
    const auto renamed = texts.find(label);
    const bool may_be_called =
        found != labels.end() && renamed != texts.end() && renamed->second.contains(found->second);
    if (found == labels.end() ? !may_be_gone : found->second != text && !may_be_called)
      violated(fmt::format("label {} ('{}') was added and is {}", label.value, text,
                           found == labels.end() ? "not kept" : "called '" + found->second + "'"));
  }
}

}  // namespace cairn::simulation
