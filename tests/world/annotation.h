// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/base/time.h"
#include "common/geometry/se3.h"
#include "tests/world/simulator.h"

namespace cairn {

/// What a recording shows and what its wearer does: `places.txt` and `phases.txt` beside `rgb.txt`.
struct Annotation {
  struct Share {
    int place = 0;       ///< index into `places`
    double share = 0;    ///< of the image
    SE3 map_from_place;  ///< the simulator's map
  };
  struct Frame {
    Timestamp time;
    std::vector<Share> shares;  ///< the largest first; empty where nothing of any place shows
  };
  struct TimedPhase {
    PhaseKind kind = PhaseKind::kWalk;
    int place = 0;
    Timestamp begin;  ///< of its first frame
    Timestamp end;    ///< of the frame after its last
  };
  std::vector<std::string> places;  ///< names
  std::vector<Frame> frames;        ///< in order of time
  std::vector<TimedPhase> phases;   ///< in order, without gaps

  /// Whether a phase of kind kMap is the place's.
  [[nodiscard]] bool mapped(int place) const;
};

/// Shares below this are left out: a sliver at the edge is nobody's view.
constexpr double kLeastShare = 0.01;

[[nodiscard]] Annotation annotate(const Simulator& simulator);

/// Writes both files. Error kIo.
[[nodiscard]] Status write_annotation(const std::filesystem::path& directory, const Annotation& annotation);
/// Reads them. Errors name file and line: kNotFound, kIo, kDamaged.
[[nodiscard]] Result<Annotation> read_annotation(const std::filesystem::path& directory);

}  // namespace cairn
