// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <variant>

#include "client/app/ports.h"
#include "client/capture/frame_source.h"

namespace cairn {

/// When frames are given to the tracker.
enum class Pace : uint8_t {
  kRealtime,  ///< a frame falls due by its time stamp, counted from the first frame's arrival; late ones are
              ///< dropped
  kMax,       ///< as fast as frames can be processed
  kLockstep,  ///< as kMax, and the server's work on a frame is waited for before the next
};

struct TakenFrame {
  Frame frame;
  PaceClock::TimePoint
      due;  ///< realtime recording: when a camera would have delivered it; else when it was taken
};
struct DroppedFrame {
  Timestamp time;
};
struct UndecodableFrame {
  std::string reason;  ///< names the file
};
struct EndOfFrames {};
using FrameEvent = std::variant<TakenFrame, DroppedFrame, UndecodableFrame, EndOfFrames>;

/// Turns a source into frames at their time. A recording at realtime pace behaves as a camera would: a frame
/// for which the tracker was too slow (its successor is due already) is dropped, so that the tracker always
/// works on the newest one. Used from one thread.
class Pacer {
 public:
  /// `stop_requested` is asked at least every 100 ms while waiting; once true, the frames end.
  Pacer(FrameSource& source, Pace pace, PaceClock& clock, std::function<bool()> stop_requested);

  /// The next event; waits until a frame is due. After EndOfFrames there are no more.
  [[nodiscard]] FrameEvent next();

 private:
  using Item = Result<std::optional<Frame>>;

  /// The frame before the present one: due times are sums of steps, so that a jump of the stamps moves all
  /// that follow.
  struct Schedule {
    Timestamp time;
    PaceClock::TimePoint due;
    std::chrono::nanoseconds step{};  ///< last regular step between two stamps
  };

  [[nodiscard]] Item take_item();
  [[nodiscard]] FrameEvent pace_recorded(Frame frame);
  [[nodiscard]] FrameEvent pace_live(Frame frame);
  [[nodiscard]] Schedule schedule_after(const std::optional<Schedule>& last, Timestamp time) const;
  [[nodiscard]] bool successor_is_due();
  [[nodiscard]] bool wait_until(PaceClock::TimePoint time);

  FrameSource& source_;
  const Pace pace_;
  PaceClock& clock_;
  const std::function<bool()> stop_requested_;
  std::optional<Item> lookahead_;
  std::optional<Schedule> last_;        ///< recording: of the last frame taken or dropped
  std::optional<Timestamp> live_time_;  ///< camera: stamp of the last frame taken or dropped
  uint64_t live_index_ = 0;             ///< camera: index that the next frame has if none was lost
};

}  // namespace cairn
