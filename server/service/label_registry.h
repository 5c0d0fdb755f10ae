// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/map/label.h"
#include "common/map/snapshot.h"
#include "common/wire/messages.h"
#include "server/store/map_file.h"

namespace cairn {

/// The label of a record, as clients are told of it.
[[nodiscard]] Label label_of(const LabelRecord& record);

/// The labels of one map. Each sticks to a keyframe, the one that it was pointed at from, and so rides on
/// adjustments; when that keyframe is gone, to the one nearest to the label. What a person asks for is judged
/// first and takes effect when it has been kept. Pure. Used from one thread.
class LabelRegistry {
 public:
  /// The outcome of a request.
  struct Judgement {
    wire::RequestDecision decision = wire::RequestDecision::kDone;
    std::string reason;                  ///< of a refusal, for a person
    LabelId label;                       ///< concerned
    std::optional<LabelRecord> changed;  ///< done: as it is to be kept; nothing: it is to be removed
  };
  /// What a new revision did to the labels.
  struct Moves {
    std::vector<LabelId> moved;         ///< noticeably, since they were told last
    std::vector<LabelRecord> anchored;  ///< to another keyframe: to be kept
  };

  /// Takes up what the store has. No new label gets an id up to `last_given`, since somebody may yet mean by
  /// it one that has been removed. To be called first.
  void restore(const std::vector<LabelRecord>& records, LabelId last_given = {});

  /// Whether a change of this label has been judged and not settled. Requests on it have to wait.
  [[nodiscard]] bool is_busy(LabelId label) const { return busy_.contains(label); }
  /// A judgement of kDone must be settled; of others nothing follows.
  [[nodiscard]] Judgement judge(const wire::ClientRequest& request, const std::string& author, Timestamp now,
                                const MapSnapshot& map);
  /// Ends what judge() began: a change that has been kept takes effect, another is forgotten.
  void settle(const Judgement& judgement, bool kept, const MapSnapshot& map);

  /// Moves the labels with their keyframes.
  [[nodiscard]] Moves follow(const MapSnapshot& map);

  /// A label as in the revision followed last; nothing: there is no such label.
  [[nodiscard]] std::optional<Label> find(LabelId label) const;
  [[nodiscard]] std::vector<Label> all() const;
  /// The greatest id that a label has had.
  [[nodiscard]] LabelId last_given() const { return LabelId{last_id_}; }

 private:
  struct Entry {
    LabelRecord record;  ///< its pose in the map is the newest
    SE3 told;            ///< map_from_label that readers have
  };
  [[nodiscard]] Judgement judge_new(const wire::ClientRequest& request, const std::string& author,
                                    Timestamp now, const MapSnapshot& map);

  std::map<LabelId, Entry> labels_;
  std::set<LabelId> busy_;
  uint64_t last_id_ = 0;
};

}  // namespace cairn
