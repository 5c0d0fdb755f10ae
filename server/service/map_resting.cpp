// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <memory>
#include <utility>

#include "server/service/map_runner.h"
#include "server/store/row_codec.h"

/// A map at rest: its images, most of its memory, are in the store only.
namespace cairn {
namespace {

/// Read in one turn of the store's writer: 3 MB or so, which takes no longer than a commit.
constexpr size_t kImagesPerTurn = 16;

constexpr const char* kUnreadable = "its pictures cannot be read back: ";

}  // namespace

void MapRunner::rest(Revision indexed) {
  queue_.post([self = shared_from_this(), indexed] {
    if (!self->may_rest(indexed)) return;
    // When the writer comes to this, all that was handed to it before is kept, or known not to be.
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
  const bool is_well = store_ != nullptr && maker_ != nullptr && !stopping_ && !frozen_;
  if (!is_well || published_ == nullptr || published_->revision != indexed) return false;
  const bool is_kept = !save_scheduled_ && !update_lost_;
  return is_kept && !maker_->has_work() && !adjusting_globally_ && awaiting_images_.expired();
}

bool MapRunner::needs_images() const {
  return !stopping_ && !frozen_ && maker_->has_work() && !maker_->lacking_images().empty();
}

void MapRunner::read_images_back(std::function<void()> then) {
  auto waiting = awaiting_images_.lock();
  const bool is_under_way = waiting != nullptr;
  if (!is_under_way) awaiting_images_ = waiting = std::make_shared<Continuations>();
  waiting->push_back(std::move(then));
  if (!is_under_way) read_next_images(waiting);
}

void MapRunner::read_next_images(const std::shared_ptr<Continuations>& waiting) {
  bool asked = false;
  guarded([&] {
    if (frozen_ || stopping_) return;
    std::vector<KeyframeId> lacking = maker_->lacking_images();
    if (lacking.empty()) return listener_.rested(maker_->statistics());
    lacking.resize(std::min(lacking.size(), kImagesPerTurn));
    store_->read_images(published_->map, std::move(lacking), [self = shared_from_this(), waiting](auto read) {
      const auto rows = std::make_shared<const ImageRows>(std::move(read));
      self->queue_.post([self, rows, waiting] { self->give_images_back(rows, 0, waiting); });
    });
    asked = true;
  });
  if (asked) return;
  awaiting_images_.reset();
  for (const auto& then : *waiting) then();
}

void MapRunner::give_images_back(const std::shared_ptr<const ImageRows>& rows, size_t next,
                                 const std::shared_ptr<Continuations>& waiting) {
  if (!*rows && !stopping_) freeze(kUnreadable + rows->error().message);
  const auto is_more = [&] { return !frozen_ && !stopping_ && next < (*rows)->size(); };
  guarded([&] {
    while (is_more()) {
      const ImageRow& row = (**rows)[next++];
      const GrayImagePtr image = decode_image_row(row.data);
      if (image == nullptr || !maker_->give_image_back(row.keyframe, image->view())) {
        return freeze(kUnreadable + ("that of keyframe " + std::to_string(row.keyframe.value)) +
                      " is not one of its camera's");
      }
      if (waiting_offers_ > 0 || urgent_.urgent_waits()) break;
    }
  });
  if (!is_more()) return read_next_images(waiting);
  queue_.post(
      [self = shared_from_this(), rows, next, waiting] { self->give_images_back(rows, next, waiting); });
}

}  // namespace cairn
