// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "common/base/time.h"
#include "common/wire/wearer_messages.h"

namespace cairn {

/// The cameras that want images of this one, and when the next image is due: ten a second at most, and none
/// while nobody asks. A camera that falls silent asks no more. Pure; one thread.
class ImageDemand {
 public:
  explicit ImageDemand(std::string camera) : camera_(std::move(camera)) {}

  void hear(const wire::PictureRequest& request, MonotonicTime now);
  [[nodiscard]] bool is_asked(MonotonicTime now) const;
  /// Names of those who ask.
  [[nodiscard]] std::vector<std::string> askers(MonotonicTime now) const;
  /// Whether a frame of now is to be sent. If so, the next one is due about a tenth of a second later.
  [[nodiscard]] bool take_turn(MonotonicTime now);

 private:
  const std::string camera_;
  std::map<std::string, MonotonicTime> asked_;  ///< by name: when last
  MonotonicTime due_;
};

}  // namespace cairn
