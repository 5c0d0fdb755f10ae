// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <memory>
#include <utility>

#include "server/service/map_runner.h"
#include "server/store/row_codec.h"

/// A map at rest: its images, most of its memory, are in the store only.
namespace cairn {
namespace {

/// Read in one turn of the store's writer: 3 MB or so, a few milliseconds (README.md); a commit takes longer.
constexpr size_t kImagesPerTurn = 16;

}  // namespace

void MapRunner::rest(Revision indexed) {
  queue_.post([self = shared_from_this(), indexed] {
    if (!self->may_rest(indexed)) return;
    // All that has been handed to the writer is kept, or known not to be, when it comes to this.
    self->store_->run([self, indexed](Store&) {
      self->queue_.post([self, indexed] {
        if (!self->may_rest(indexed)) return;
        self->maker_->let_images_go();
        self->listener_.rested(self->maker_->statistics());
      });
    });
  });
}

bool MapRunner::may_rest(Revision indexed) const {
  const bool is_kept = store_ != nullptr && !save_scheduled_ && !update_lost_;
  const bool is_idle = !stopping_ && !frozen_ && !adjusting_globally_ && awaiting_images_.empty() &&
                       maker_ != nullptr && !maker_->has_work();
  return is_kept && is_idle && published_ != nullptr && published_->revision == indexed;
}

bool MapRunner::needs_images() const {
  return !stopping_ && !frozen_ && maker_->has_work() && !maker_->lacking_images().empty();
}

void MapRunner::read_images_back(std::function<void()> then) {
  awaiting_images_.push_back(std::move(then));
  if (awaiting_images_.size() == 1) read_next_images();
}

void MapRunner::read_next_images() {
  bool asked = false;
  guarded([&] {
    if (frozen_ || stopping_) return;
    std::vector<KeyframeId> lacking = maker_->lacking_images();
    if (lacking.empty()) return listener_.rested(maker_->statistics());
    lacking.resize(std::min(lacking.size(), kImagesPerTurn));
    store_->read_images(published_->map, std::move(lacking), [self = shared_from_this()](auto rows) {
      auto shared = std::make_shared<const Result<std::vector<ImageRow>>>(std::move(rows));
      self->queue_.post([self, shared] { self->give_images_back(shared, 0); });
    });
    asked = true;
  });
  if (asked) return;
  for (const auto& then : std::exchange(awaiting_images_, {})) then();
}

void MapRunner::give_images_back(std::shared_ptr<const Result<std::vector<ImageRow>>> rows, size_t next) {
  constexpr const char* kUnreadable = "its pictures cannot be read back: ";
  if (!*rows && !stopping_) freeze(kUnreadable + rows->error().message);
  guarded([&] {
    while (!frozen_ && !stopping_ && next < (*rows)->size()) {
      const ImageRow& row = (**rows)[next++];
      const GrayImagePtr image = decode_image_row(row.data);
      if (image == nullptr || !maker_->give_image_back(row.keyframe, image->view()))
        return freeze(kUnreadable + ("that of keyframe " + std::to_string(row.keyframe.value)) +
                      " is not one of its camera's");
      if (waiting_offers_ > 0 || urgent_.urgent_waits()) break;
    }
  });
  if (!frozen_ && !stopping_ && next < (*rows)->size()) {
    queue_.post(
        [self = shared_from_this(), rows = std::move(rows), next] { self->give_images_back(rows, next); });
  } else {
    read_next_images();
  }
}

}  // namespace cairn
