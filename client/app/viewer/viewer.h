// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "client/app/frame_observer.h"
#include "client/app/viewer/controls.h"
#include "common/base/log.h"

namespace cairn {

/// The calls by which the window uses the session, the rig and the wearer's other cameras, on the window's
/// thread.
struct ViewerLink {
  std::function<LabelListPtr(MapId)> labels;
  std::function<void(wire::ClientRequest)> request;
  std::function<std::vector<RequestReply>()> take_replies;
  std::function<void(RigKey)> rig = [](RigKey) {};
  /// The wearer's other cameras: their names, the one whose image is wanted (empty: none), and what has come.
  std::function<std::vector<std::string>()> cameras = [] { return std::vector<std::string>(); };
  std::function<void(const std::string&)> choose_camera = [](const std::string&) {};
  std::function<OtherView()> other = [] { return OtherView(); };
};

/// The live view: an OpenCV window with the overlay, in a thread of its own that works on copies. The frame
/// loop never waits for it: a frame that comes while the last one is being drawn takes its place. A window
/// system that fails ends the window, not the tracking.
class Viewer final : public FrameObserver {
 public:
  Viewer(CameraPtr camera, const std::string& title, ViewerOptions options, ViewerLink link, Logger log);
  /// Closes the window.
  ~Viewer() override;
  Viewer(const Viewer&) = delete;
  Viewer& operator=(const Viewer&) = delete;

  void on_frame(const FrameReport& report) override;

  /// Whether the person has asked to quit or has closed the window.
  [[nodiscard]] bool quit_requested() const { return quit_; }
  /// Whether a new map was asked for since the last call.
  [[nodiscard]] bool take_new_map_request() { return new_map_.exchange(false); }

 private:
  struct Window;
  void run();
  void serve(Window* window);
  void carry_out(ViewerWishes wishes);

  const CameraPtr camera_;
  const std::string title_;
  const ViewerLink link_;
  const ViewerOptions options_;
  Logger log_;
  std::atomic<bool> quit_{false};
  std::atomic<bool> new_map_{false};
  std::atomic<bool> stopping_{false};

  std::mutex mutex_;
  std::optional<OverlayFrame> newest_;  ///< guarded by mutex_

  std::thread thread_;  ///< last: it uses all the above
};

}  // namespace cairn
