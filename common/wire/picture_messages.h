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

/// Topic WearerCamera: state. A tracker that gives its pictures to whoever of the wearer's asks.
struct WearerCamera {
  std::string name;    ///< the client's
  uint32_t width = 0;  ///< of its frames [px]
  uint32_t height = 0;
};

/// Topic PictureRequest: stream, said again and again as long as pictures are wanted.
struct PictureRequest {
  std::string name;    ///< of the client that asks
  std::string camera;  ///< name of the client whose pictures it wants; empty: of nobody any more
};

constexpr uint32_t kMaxPictureSide = 640;    ///< [px]
constexpr size_t kMaxPictureBytes = 60'000;  ///< of a JPEG: a picture is one datagram of the loopback profile
constexpr size_t kMaxPictureNote = 360;      ///< [bytes]

/// Topic CameraPicture: stream. What the tracker of a camera shows of its newest frame.
struct CameraPicture {
  std::string name;  ///< the client's
  Timestamp time;    ///< of the frame
  TrackingState state = TrackingState::kStarting;
  std::string map;       ///< name of the map that it is in; empty: none
  std::string note;      ///< for a person
  ImageMessage picture;  ///< a JPEG, in colours
};

}  // namespace cairn::wire
