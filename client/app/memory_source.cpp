// SPDX-License-Identifier: Apache-2.0
#include "client/app/memory_source.h"

#include <utility>

namespace cairn {

MemorySource::MemorySource(FrameSource& recording, const std::function<bool()>& stop_requested)
    : frame_count_(recording.frame_count()),
      calibration_(recording.builtin_calibration()),
      image_size_(recording.image_size()),
      description_(recording.describe()) {
  while (!stop_requested()) {
    auto item = recording.next();
    if (item && !*item) return;
    items_.push_back(std::move(item));
  }
}

Result<std::optional<Frame>> MemorySource::next() {
  if (items_.empty()) return std::nullopt;
  auto item = std::move(items_.front());
  items_.pop_front();
  return item;
}

}  // namespace cairn
