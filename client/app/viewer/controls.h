// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <opencv2/core/types.hpp>
#include <optional>
#include <string>
#include <vector>

#include "client/app/images/image_choice.h"
#include "client/app/overlay.h"
#include "client/app/text_painter.h"
#include "client/app/viewer/text_entry.h"
#include "client/session/session.h"
#include "common/base/time.h"
#include "common/wire/messages.h"

namespace cairn {

/// Keys for the rig that carries the camera.
enum class RigKey : uint8_t { kStop, kClear, kNeutral, kFollow, kLock, kFixate, kSearch };

/// What a person in front of the window wants from the rest of the program.
struct ViewerWishes {
  bool quit = false;
  bool new_map = false;
  std::optional<RigKey> rig;
  std::vector<wire::ClientRequest> requests;
};

struct ViewerOptions {
  bool may_label = true;  ///< --role reader: no
  bool has_rig = false;
  bool may_make_maps = true;  ///< else the key for a new map looks for one of the server's
  std::string wearer = {};    ///< whose other cameras may be shown; empty: nobody's
};

/// The window's behaviour: what keys and touches do. Pure; knows nothing of a window system. Used from one
/// thread.
class ViewerControls {
 public:
  ViewerControls(CameraPtr camera, ViewerOptions options) : camera_(std::move(camera)), options_(options) {}

  /// A frame from the tracker. It becomes the one shown unless the view is frozen.
  void show(OverlayFrame frame);
  /// A code of OpenCV's waitKeyEx().
  void press(int key_code, MonotonicTime now);
  /// A person touches the window's image of this size at `point`. Its upper part shows the camera's image
  /// enlarged `scale` times.
  void touch(cv::Point point, cv::Size image, int scale, MonotonicTime now);
  void replied(const RequestReply& reply, MonotonicTime now);
  /// Names of the wearer's other cameras, and what has come of the one that is wanted. A frozen view stays.
  void show_others(std::vector<std::string> cameras, OtherView view);

  /// The wishes since the last call.
  [[nodiscard]] ViewerWishes take_wishes() { return std::exchange(wishes_, {}); }

  // What is shown.
  [[nodiscard]] const std::optional<OverlayFrame>& frame() const { return frame_; }
  /// Sets the labels of the map shown. Whether they differ from those before.
  bool set_labels(const LabelListPtr& labels) {
    return frame_ && std::exchange(frame_->labels, labels) != labels;
  }
  /// The wearer's other camera that is shown large, with this one small; without a name where none is.
  [[nodiscard]] const OtherView& other() const { return other_; }
  /// Name of the camera whose image is wanted; empty: none.
  [[nodiscard]] const std::string& wanted() const { return wanted_; }
  [[nodiscard]] bool frozen() const { return frozen_; }
  [[nodiscard]] bool points_shown() const { return points_shown_; }
  [[nodiscard]] bool help_shown() const { return help_shown_; }
  [[nodiscard]] LabelId selected() const { return selected_.id; }
  [[nodiscard]] bool has_rig() const { return options_.has_rig; }
  /// The line of text while one is being typed; else null.
  [[nodiscard]] const TextEntry* entry() const { return typing_ ? &typing_->entry : nullptr; }
  /// A word to the person; empty when the last one is some seconds old.
  [[nodiscard]] std::string message(MonotonicTime now) const;
  /// The keys, a line each.
  [[nodiscard]] static std::vector<std::string> help();

 private:
  struct Selection {
    MapId map;
    LabelId id;
  };
  /// The request that waits for its text.
  struct Typing {
    wire::ClientRequest request;
    TextEntry entry;
  };
  void type(EntryStroke stroke, MonotonicTime now);
  void command(char key, MonotonicTime now);
  [[nodiscard]] bool command_rig(char key, MonotonicTime now);
  void go_on();
  void switch_camera(MonotonicTime now);
  void point_at(const Eigen::Vector2d& pixel, MonotonicTime now);
  void delete_selected(MonotonicTime now);
  void edit_selected(MonotonicTime now);
  [[nodiscard]] const Label* selected_label() const;
  /// The camera of the frame shown, as it was then calibrated.
  [[nodiscard]] const Camera& camera() const { return *(frame_->camera ? frame_->camera : camera_); }
  void say(std::string message, MonotonicTime now);

  CameraPtr camera_;     ///< as at the start
  TextPainter painter_;  ///< measures labels as they are drawn
  ViewerOptions options_;
  std::optional<OverlayFrame> frame_;
  std::optional<OverlayFrame> missed_;  ///< the newest, while the view is frozen
  std::vector<std::string> cameras_;
  std::string wanted_;
  OtherView other_;
  bool frozen_ = false;
  bool points_shown_ = true;
  bool help_shown_ = false;
  Selection selected_;
  std::optional<Typing> typing_;
  std::string message_;
  MonotonicTime said_at_;
  ViewerWishes wishes_;
};

}  // namespace cairn
