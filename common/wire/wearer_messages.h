// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "common/base/time.h"
#include "common/wire/messages.h"

/// What the cameras of one wearer say to each other on the wearer's own host, without a server: the topics of
/// the partition `wearer.<name>`.
namespace cairn::wire {

/// Topic WearerCamera: state. A tracker that gives its images to whoever of the wearer's asks.
struct WearerCamera {
  std::string name;    ///< the client's
  uint32_t width = 0;  ///< of its frames [px]
  uint32_t height = 0;
};

/// Topic PictureRequest: stream, said again and again as long as images are wanted.
struct PictureRequest {
  std::string name;    ///< of the client that asks
  std::string camera;  ///< name of the client whose images it wants; empty: of nobody any more
};

constexpr uint32_t kMaxCameraImageSide = 640;  ///< [px]
/// [bytes] Longest JPEG of a camera's image: one datagram of the loopback profile.
constexpr size_t kMaxCameraImageBytes = 60'000;
constexpr size_t kMaxCameraPictureNote = 360;  ///< [bytes]

/// Topic CameraPicture: stream. What the tracker of a camera shows of its newest frame.
struct CameraPicture {
  std::string name;  ///< the client's
  Timestamp time;    ///< of the frame
  TrackingState state = TrackingState::kStarting;
  std::string map;     ///< name of the map that it is in; empty: none
  std::string note;    ///< for a person
  ImageMessage image;  ///< a JPEG, in colours
};

}  // namespace cairn::wire
