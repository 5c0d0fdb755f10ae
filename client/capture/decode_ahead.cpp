// SPDX-License-Identifier: Apache-2.0
#include "client/capture/decode_ahead.h"

#include <algorithm>

namespace cairn {

DecodeAhead::DecodeAhead(std::unique_ptr<FrameSource> source, size_t queue_frames)
    : frame_count_(source->frame_count()),
      calibration_(source->builtin_calibration()),
      image_size_(source->image_size()),
      description_(source->describe()),
      is_live_(source->is_live()),
      capacity_(is_live_ ? 1 : std::max<size_t>(1, queue_frames)),
      source_(std::move(source)),
      thread_([this] { run(); }) {}

DecodeAhead::~DecodeAhead() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void DecodeAhead::run() {
  while (true) {
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [this] { return stopping_ || is_live_ || queue_.size() < capacity_; });
      if (stopping_) return;
    }
    auto item = next_of_source();
    const std::lock_guard lock(mutex_);
    at_end_ = item.has_value() && !item->has_value();
    if (at_end_) {
      changed_.notify_all();
      return;
    }
    if (queue_.size() >= capacity_) queue_.pop_front();
    queue_.push_back(std::move(item));
    changed_.notify_all();
  }
}

/// The source's next frame. What a decoder throws (no memory for a huge image) is told as a frame that cannot
/// be read.
Result<std::optional<Frame>> DecodeAhead::next_of_source() {
  try {
    return source_->next();
  } catch (const std::exception& error) {
    return fail(ErrorCode::kDamaged, description_ + ": " + error.what());
  }
}

Result<std::optional<Frame>> DecodeAhead::next() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return at_end_ || !queue_.empty(); });
  if (queue_.empty()) return std::nullopt;
  auto item = std::move(queue_.front());
  queue_.pop_front();
  changed_.notify_all();
  return item;
}

}  // namespace cairn
