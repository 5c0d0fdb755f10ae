// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "client/app/frame_observer.h"
#include "client/app/images/image_choice.h"
#include "client/app/images/image_demand.h"
#include "client/app/overlay.h"
#include "client/app/stats.h"
#include "common/base/log.h"
#include "common/base/rate_limit.h"
#include "common/wire/participant.h"
#include "common/wire/topic.h"
#include "common/wire/waiter.h"

namespace cairn {

struct ImageLinkOptions {
  std::string wearer;
  std::string name;  ///< the client's
  int domain = 0;
  std::string security = {};  ///< folder of the client's keys; empty: an open site
};

/// Images between the cameras of one wearer on one host (README.md of this folder): gives those of this
/// camera, as the tracker sees them, to who asks, and asks for those of another. All work is on a thread of
/// its own; a frame costs the tracker a look at a flag, and ten times a second, while somebody asks, a copy
/// of what is drawn. Thread-safe.
class ImageLink final : public FrameObserver {
 public:
  /// Errors: those of Participant::create().
  [[nodiscard]] static Result<std::unique_ptr<ImageLink>> open(const ImageLinkOptions& options,
                                                               CameraPtr camera, Logger log);
  /// Leaves the other cameras, as close() does.
  ~ImageLink() override { close(); }
  ImageLink(const ImageLink&) = delete;
  ImageLink& operator=(const ImageLink&) = delete;

  void on_frame(const FrameReport& report) override;

  /// Names of the wearer's other cameras on this host.
  [[nodiscard]] std::vector<std::string> cameras();
  /// Chooses the camera whose images are wanted; empty: nobody's any more.
  void choose(const std::string& camera);
  [[nodiscard]] OtherView view();

  [[nodiscard]] ImageSummary summary();
  /// Leaves the other cameras; what has come stays.
  void close();

 private:
  ImageLink(const ImageLinkOptions& options, CameraPtr camera, Logger log, wire::Participant participant,
            wire::Writer<wire::WearerCamera> own, wire::Writer<wire::PictureRequest> requests,
            wire::Writer<wire::CameraPicture> images, wire::Reader<wire::WearerCamera> others,
            wire::Reader<wire::PictureRequest> asked, wire::Reader<wire::CameraPicture> seen,
            wire::Waiter waiter);
  void run();
  void listen();
  void receive(const wire::CameraPicture& message);
  void ask();
  void send();
  void tell();
  void tell_demand(MonotonicTime now, const std::vector<std::string>& askers);

  const ImageLinkOptions options_;
  const CameraPtr camera_;
  Logger log_;
  wire::Participant participant_;
  wire::Writer<wire::WearerCamera> own_;
  wire::Writer<wire::PictureRequest> requests_;
  wire::Writer<wire::CameraPicture> images_;
  wire::Reader<wire::WearerCamera> others_;
  wire::Reader<wire::PictureRequest> asked_;
  wire::Reader<wire::CameraPicture> seen_;
  wire::Waiter waiter_;
  std::atomic<bool> is_asked_{false};
  std::atomic<bool> ends_{false};

  std::mutex mutex_;
  ImageDemand demand_;                 ///< guarded by mutex_
  ImageChoice choice_;                 ///< guarded by mutex_
  std::optional<OverlayFrame> frame_;  ///< to be sent; guarded by mutex_
  ImageSummary counts_;                ///< guarded by mutex_

  // Of the thread.
  std::optional<Overlay> overlay_;
  std::vector<std::string> askers_;  ///< as told
  MonotonicTime asked_since_;
  size_t sent_before_ = 0;
  std::string said_;  ///< of the view
  RateLimit warning_;
  std::thread thread_;  ///< last: it uses all the above
};

}  // namespace cairn
