// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace cairn {

/// Stages of a frame, for the profile handed in by the shell.
enum class Stage : uint8_t {
  kPyramid,
  kCorners,
  kPrior,
  kProject,
  kCoarse,
  kFine,
  kPose,
  kTrails,
  kRecover,
  kDescribe,
  kCount
};
[[nodiscard]] const char* to_string(Stage stage);

/// The shell's stopwatch: the engine itself never asks a clock.
class StageProbe {
 public:
  virtual ~StageProbe() = default;
  virtual void begin(Stage stage) = 0;
  virtual void end(Stage stage) = 0;
};

class ScopedStage {
 public:
  /// `probe` may be null.
  ScopedStage(StageProbe* probe, Stage stage) : probe_(probe), stage_(stage) {
    if (probe_ != nullptr) probe_->begin(stage_);
  }
  ~ScopedStage() {
    if (probe_ != nullptr) probe_->end(stage_);
  }
  ScopedStage(const ScopedStage&) = delete;
  ScopedStage& operator=(const ScopedStage&) = delete;

 private:
  StageProbe* probe_;
  Stage stage_;
};

}  // namespace cairn
