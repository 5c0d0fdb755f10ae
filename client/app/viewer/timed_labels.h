// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <opencv2/core/types.hpp>
#include <string>
#include <vector>

#include "client/app/frame_observer.h"
#include "client/app/viewer/label_file.h"
#include "client/app/viewer/viewer.h"
#include "common/base/log.h"
#include "common/base/result.h"

namespace cairn {

/// The request of a person who points at a pixel of the frame in the window, types the text and presses
/// Enter. Error kRefused: why there is no label there, in the window's words. Pure.
[[nodiscard]] Result<wire::ClientRequest> ask_for_label(const OverlayFrame& frame, const CameraPtr& camera,
                                                        cv::Point pixel, const std::string& text);

/// Places labels when their time has come, without a window, and says what became of each. Used from the
/// thread of the frame loop.
class LabelPlacer final : public FrameObserver {
 public:
  /// Labels in order of time.
  LabelPlacer(const std::vector<TimedLabel>& labels, CameraPtr camera, ViewerLink link, Logger log);

  void on_frame(const FrameReport& report) override;
  /// Tells, after the last frame, what the server has said since, and what could not be placed.
  void finish();

 private:
  void place(const FrameReport& report, const TimedLabel& label);
  void take_replies();

  std::deque<TimedLabel> waiting_;
  std::deque<std::string> asked_;  ///< texts that the server has not decided on, in the order sent
  const CameraPtr camera_;         ///< as at the start
  const ViewerLink link_;
  Logger log_;
  const size_t total_;
  size_t kept_ = 0;
};

}  // namespace cairn
