// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>

#include "common/base/time.h"
#include "common/map/snapshot.h"

namespace cairn::simulation {

/// What is known of a map by what a server has said of it, through tags and roll-backs. Times are of
/// images, no two alike; moments are counted by who hears all.
class MadeMap {
 public:
  using Moment = uint64_t;

  std::string name;  ///< empty: nobody has heard that it was made
  bool is_deleted = false;
  bool was_rolled_back = false;  ///< perhaps, once
  bool proposals_are_accepted = false;
  std::map<LabelId, std::set<std::string>> texts;
  std::set<LabelId> maybe_removed;

  /// An offer or a seed that arrived first at that moment has been accepted now. False: as another keyframe
  /// was before.
  [[nodiscard]] bool accept(KeyframeId keyframe, Timestamp image, Moment arrived);
  /// Notes a keyframe that was made of a proposal: which image it is, its operator is not told.
  void accept_proposal(KeyframeId keyframe) { proposed_.insert(keyframe); }
  [[nodiscard]] bool label(LabelId label, const std::string& text, Moment arrived);

  void ask_to_tag() { asked_ = {keyframes_, labels_, proposed_, {}, {}}; }
  /// `shown`: keyframes that any revision has shown.
  void tag(const std::string& name, std::set<KeyframeId> shown, Moment now);
  [[nodiscard]] std::set<std::string> tags() const;
  void ask_to_roll_back(const std::string& tag, Epoch now);
  /// Notes that a roll-back was done. Returns what is wrong with what is shown then; nothing: all is right.
  [[nodiscard]] std::optional<std::string> roll_back(const MapSnapshot& newest, Moment now);
  void refuse_roll_back() { rolling_back_.reset(); }

  /// A map of its own, which has what this one has.
  [[nodiscard]] MadeMap copy() const;

  using Tell = std::function<void(const std::string& what)>;
  /// Holds the file against it: all of it is there, once, and nothing that has gone. The server has ended, so
  /// what it was asked for last has happened or not.
  void check_kept(const std::filesystem::path& file, Moment now, const Tell& violated);
  /// A copy of the file that was made when this was known: nothing of it is missing.
  void check_copied(const std::filesystem::path& file, const Tell& violated) const;

 private:
  struct Tagged {
    std::map<KeyframeId, Timestamp> keyframes;  ///< that are in it for certain
    std::map<LabelId, std::string> labels;
    std::set<KeyframeId> proposed;
    std::set<KeyframeId> shown;  ///< any that may be in it
    Moment told = 0;
  };
  struct RollingBack {
    std::string tag;
    Epoch from;
  };
  void become(const Tagged& tag, Moment now);
  void check_rows(const std::filesystem::path& file, const Tell& violated) const;

  std::map<KeyframeId, Timestamp> keyframes_;  ///< that were accepted
  std::map<LabelId, std::string> labels_;      ///< that were added
  std::set<KeyframeId> proposed_;              ///< that were proposals
  std::map<Timestamp, Moment> arrived_;        ///< of all images that were ever accepted
  std::set<Timestamp> gone_;                   ///< images that came after the tag that it was rolled back to
  Tagged asked_;
  std::map<std::string, Tagged> tags_;
  std::optional<RollingBack> rolling_back_;
  size_t roll_backs_ = 0;
  Moment rolled_back_at_ = 0;
};

}  // namespace cairn::simulation
