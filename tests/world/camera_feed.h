// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "common/base/file_descriptor.h"
#include "common/base/result.h"
#include "common/base/time.h"
#include "common/geometry/se3.h"

/// The true poses of a simulated camera, sent by the process that moves it to those that render what it sees,
/// judge it, or both: packets of a local socket, a moment each.
namespace cairn {

struct CameraMoment {
  Timestamp time;
  SE3 map_from_camera;
};

/// The end that knows. One thread.
class CameraFeed {
 public:
  /// Makes the socket; one that a process left there is replaced. Errors: kUsage (a path that no socket can
  /// have), kRefused (somebody feeds there), kIo.
  [[nodiscard]] static Result<CameraFeed> open(const std::string& path);
  CameraFeed(CameraFeed&&) = default;
  CameraFeed& operator=(CameraFeed&&) = default;
  ~CameraFeed();

  /// Sends a moment to all that have come. Who does not read what was sent misses moments.
  void tell(const CameraMoment& moment);

 private:
  CameraFeed(FileDescriptor listener, std::string path)
      : listener_(std::move(listener)), path_(std::move(path)) {}

  FileDescriptor listener_;
  std::string path_;
  std::vector<FileDescriptor> readers_;
};

/// The end that asks: keeps the last second, in order. One thread.
class CameraTruth {
 public:
  /// Error kNotFound where nobody feeds.
  [[nodiscard]] static Result<CameraTruth> join(const std::string& path);

  enum class News { kSome, kNone, kEnd };
  /// Takes what has come; waits for it, but no longer than that.
  [[nodiscard]] News wait(std::chrono::milliseconds most);
  /// When the newest and the oldest moment that are kept were; nothing before the first.
  [[nodiscard]] std::optional<Timestamp> newest() const;
  [[nodiscard]] std::optional<Timestamp> oldest() const;
  /// Between moments; where it is unknown, as at the nearest that is known. There must be one.
  [[nodiscard]] SE3 map_from_camera(Timestamp time) const;

 private:
  explicit CameraTruth(FileDescriptor socket) : socket_(std::move(socket)) {}

  FileDescriptor socket_;
  std::deque<CameraMoment> moments_;
};

}  // namespace cairn
