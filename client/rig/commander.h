// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <chrono>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "client/rig/commander_options.h"
#include "common/base/time.h"
#include "common/map/ids.h"
#include "common/wire/rig_messages.h"

namespace cairn {

/// What a person wants the rig to do while its camera is tracked.
enum class RigAim : uint8_t { kNeutral, kFollow, kLock, kFixate, kSearch };
[[nodiscard]] std::string_view to_string(RigAim aim);

/// The tracker's report on a frame.
struct RigSight {
  Timestamp time;                         ///< of the frame, by the host's clock
  bool tracked = false;                   ///< its pose is known
  bool poor = false;                      ///< and by few of the points in sight only, as at the edge of a map
  bool lost = false;                      ///< it is not, and the camera is looked for in maps
  bool verifying = false;                 ///< a pose is being verified
  MapId map;                              ///< that it is tracked in
  std::optional<Eigen::Vector3d> target;  ///< to be fixated, as the camera saw it
};

/// The tracker of a rig's camera as the rig's commander: what it says of frames and what a person wants go
/// in, an order comes out, to be said again as long as it holds. A rig that is not homed is homed first.
/// While the camera is lost the rig searches, first where the camera looked when it was tracked last, then
/// where it was tracked last in each map before that; it looks at a place that is being verified, goes on if
/// that fails, and when the camera is found it is as it was. Only *neutral* leaves the camera where the
/// wearer points it. Pure; one thread.
class RigCommander {
 public:
  /// Names of rig and commander; `session` is this process's.
  RigCommander(std::string rig, std::string name, SessionId session, RigAim aim,
               wire::RigSearchPattern pattern, const CommanderOptions& options);

  void want(RigAim aim);
  /// Emergency stop, whoever commands the rig, until clear(). After a stop, whoever asked for it, nothing
  /// moves until somebody wants something.
  void stop();
  /// Forgets an emergency stop and faults of axes. Nothing moves.
  void clear();
  /// The drives are to be let go, for good.
  void close();

  void hear(const wire::RigState& state, MonotonicTime now);
  void see(const RigSight& sight);
  /// The place told of the frame of that time is going to be verified.
  void try_place(Timestamp asked);

  /// The order that is to be said now, 20 times a second or more. Nothing while the rig is not heard, unless
  /// it is a stop or, after close(), that the drives may go: it may hear these all the same.
  [[nodiscard]] std::optional<wire::RigCommand> command(MonotonicTime now);
  /// Whether a stop was asked for that was neither said nor obeyed yet.
  [[nodiscard]] bool is_urgent() const {
    return stop_asked_ && order_.mode != wire::RigMode::kStop && !(state_ && state_->stopped);
  }
  /// Says to a person what the rig does, or what keeps it from that.
  [[nodiscard]] std::string describe(MonotonicTime now) const;
  /// Whether close() was called and nothing is left to be said.
  [[nodiscard]] bool is_over() const;
  [[nodiscard]] RigAim aim() const { return aim_; }
  [[nodiscard]] int wants() const { return wants_; }  ///< how often somebody wanted something

  struct Counts {
    int searches = 0;
    int candidates = 0;  ///< places looked at during them
  };
  [[nodiscard]] const Counts& counts() const { return counts_; }

 private:
  enum class Looking : uint8_t { kNot, kSearching, kAtCandidate };
  struct View {
    Timestamp time;
    Eigen::Vector3d direction;  ///< in the rig's world
  };

  struct Heading {
    MapId map;
    Eigen::Vector3d direction;  ///< in the rig's world
  };

  /// What the camera has found, by which a search goes on or ends.
  struct Nothing {};
  struct PoorView {             ///< the first that this search went past
    Eigen::Vector3d direction;  ///< in the rig's world
    double looked_at = 0;       ///< wire::RigState::looked_at then
  };
  struct NothingBetter {};  ///< than the poor view to which the camera was turned back: it will do
  struct Enough {};         ///< tracked well enough to end a search, and not lost since
  using Found = std::variant<Nothing, PoorView, NothingBetter, Enough>;

  void remember(MapId map, const Eigen::Vector3d& direction);
  [[nodiscard]] bool passes_by(const RigSight& sight, const std::optional<Eigen::Vector3d>& direction);
  [[nodiscard]] bool is_round_over() const;
  void look_again();
  [[nodiscard]] bool has_found_enough() const { return std::holds_alternative<Enough>(found_); }
  [[nodiscard]] wire::RigCommand wanted() const;
  [[nodiscard]] wire::RigCommand aimed() const;
  [[nodiscard]] std::optional<Eigen::Vector3d> direction_at(Timestamp image) const;
  [[nodiscard]] bool is_due_again(const wire::RigCommand& order) const;
  [[nodiscard]] bool is_faulted() const;
  [[nodiscard]] bool is_any(wire::RigAxisCondition condition) const;  ///< of the axes
  [[nodiscard]] bool is_heard(MonotonicTime now) const;

  CommanderOptions options_;
  std::string rig_;
  std::string name_;
  RigAim aim_;
  wire::RigSearchPattern pattern_;
  Looking looking_ = Looking::kNot;
  bool stop_asked_ = false;
  bool clear_asked_ = false;
  bool closed_ = false;
  bool rests_ = false;  ///< was stopped: a person begins anew
  Found found_;
  std::optional<Timestamp> lost_since_;
  std::optional<Timestamp> candidate_since_;
  std::vector<Heading> seen_at_;  ///< where the camera looked when it was tracked last in a map, newest first
  Eigen::Vector3d candidate_at_ = Eigen::Vector3d::Zero();
  std::optional<RigSight> sighting_;  ///< the newest that has the target
  std::deque<View> views_;            ///< of the last seconds
  std::optional<wire::RigState> state_;
  MonotonicTime heard_;
  std::array<std::chrono::nanoseconds, 2> gaps_{};  ///< between the last states, by our clock
  std::optional<Timestamp> turns_ahead_until_;      ///< homed just now; by the rig's clock
  wire::RigCommand order_;                          ///< said last; of number 0: none
  Timestamp ordered_;  ///< when it was said first, by the rig's clock, which may be a slowed one
  Counts counts_;
  int wants_ = 0;
};

}  // namespace cairn
