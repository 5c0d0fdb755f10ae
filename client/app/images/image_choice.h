// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <opencv2/core.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "client/app/frame_observer.h"
#include "common/base/time.h"
#include "common/wire/wearer_messages.h"

namespace cairn {

/// How often a camera says again whose images it wants.
inline constexpr std::chrono::milliseconds kPictureRequestPeriod{200};
/// The age from which an image does not show the present any more.
inline constexpr std::chrono::milliseconds kImageTooOld{1000};

/// The view of another camera of the wearer's, as it is shown.
struct OtherView {
  std::string camera;     ///< name; empty: none is wanted
  bool is_there = false;  ///< its tracker runs on this host
  cv::Mat pixels;         ///< BGR, shared, not written to; empty: none has come yet
  FrameState state = FrameState::kStarting;
  std::string map;                  ///< name; empty: none
  std::string note;                 ///< of its tracker
  std::chrono::milliseconds age{};  ///< since the image came, or since it was asked for
};
[[nodiscard]] inline bool is_stale(const OtherView& view) {
  return view.pixels.empty() || view.age > kImageTooOld;
}
/// Says to a person what the image is, or why there is none.
[[nodiscard]] std::string describe(const OtherView& view);

/// Which other cameras of the wearer there are on this host, whose images are wanted, and what has come of
/// them. Pure; one thread.
class ImageChoice {
 public:
  explicit ImageChoice(std::string name) : name_(std::move(name)) {}

  void come(const wire::WearerCamera& camera);
  void gone(const std::string& camera) { cameras_.erase(camera); }
  /// Names of the wearer's other cameras, in order.
  [[nodiscard]] std::vector<std::string> cameras() const { return {cameras_.begin(), cameras_.end()}; }

  /// Chooses the camera whose images are wanted; empty: nobody's.
  void choose(const std::string& camera, MonotonicTime now);
  [[nodiscard]] const std::string& chosen() const { return view_.camera; }
  /// The request that is to be sent now, if any; it counts as sent.
  [[nodiscard]] std::optional<wire::PictureRequest> request(MonotonicTime now);
  /// `pixels`: of the image. One that was not asked for is dropped.
  void receive(const wire::CameraPicture& message, cv::Mat pixels, MonotonicTime now);
  [[nodiscard]] OtherView view(MonotonicTime now) const;

 private:
  const std::string name_;
  std::set<std::string> cameras_;
  OtherView view_;
  MonotonicTime since_;  ///< as OtherView::age
  std::optional<MonotonicTime> said_;
  bool ends_ = false;  ///< it is to be said that nobody's are wanted any more
};

}  // namespace cairn
