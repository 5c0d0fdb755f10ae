// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/eventfd.h>

#include <cerrno>
#include <cstring>

#include "common/base/file_descriptor.h"
#include "common/base/result.h"

namespace cairn {

/// Wakes a thread that polls its descriptor(). Thread-safe.
class WakeUp {
 public:
  /// Error kIo.
  [[nodiscard]] static Result<WakeUp> create() {
    FileDescriptor made(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
    if (made.get() < 0) return fail(ErrorCode::kIo, std::string("eventfd: ") + std::strerror(errno));
    return WakeUp(std::move(made));
  }
  void wake() const { (void)eventfd_write(event_.get(), 1); }
  void clear() const {
    eventfd_t count = 0;
    (void)eventfd_read(event_.get(), &count);
  }
  [[nodiscard]] int descriptor() const { return event_.get(); }

 private:
  explicit WakeUp(FileDescriptor event) : event_(std::move(event)) {}
  FileDescriptor event_;
};

}  // namespace cairn
