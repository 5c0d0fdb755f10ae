// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <new>
#include <utility>

#include "server/service/map_runner.h"
#include "server/store/row_codec.h"

/// An idle map: its images, most of its memory, are in the store only.
namespace cairn {
namespace {

constexpr const char* kUnreadable = "its images cannot be read back: ";

/// Whether it is no use to read again: the file is broken, or has been taken away. A disk may answer again,
/// and memory be free.
bool is_for_good(const Error& error) {
  return error.code != ErrorCode::kIo;
}

}  // namespace

void MapRunner::evict_images(std::pair<Epoch, Revision> indexed) {
  queue_.post([self = shared_from_this(), indexed] {
    if (!self->may_evict(indexed)) return;
    // When the writer comes to this, all that was handed to it before is kept, or known not to be. Of what
    // comes between the two looks that is not known.
    self->store_->run([self, indexed, before = self->changes_](Store&) {
      self->queue_.post([self, indexed, before] {
        if (self->changes_ != before || !self->may_evict(indexed)) return;
        self->maker_->evict_images();
        self->listener_.paged(self->maker_->statistics());
      });
    });
  });
}

bool MapRunner::may_evict(const std::pair<Epoch, Revision>& indexed) const {
  const bool is_well = store_ != nullptr && maker_ != nullptr && !stopping_ && !frozen_;
  if (!is_well || published_ == nullptr) return false;
  if (std::pair(published_->epoch, published_->revision) != indexed) return false;
  const bool is_kept = !save_scheduled_ && !update_lost_;
  return is_kept && !maker_->has_work() && !adjusting_globally_ && awaiting_images_.expired();
}

bool MapRunner::needs_images() const {
  return !stopping_ && !frozen_ && maker_->has_work() && maker_->lacks_any_images();
}

void MapRunner::page_in(std::function<void()> then) {
  auto waiting = awaiting_images_.lock();
  const bool is_under_way = waiting != nullptr;
  if (!is_under_way) waiting = std::make_shared<Continuations::element_type>();
  waiting->push_back(std::move(then));
  if (is_under_way) return;
  awaiting_images_ = waiting;
  read_on(waiting, [&] { return read_next_images(waiting); });
}

void MapRunner::read_on(const Continuations& waiting, const std::function<bool()>& part) {
  bool goes_on = false;
  guarded([&] {
    if (frozen_ || stopping_) return;
    try {
      goes_on = part();
    } catch (const std::bad_alloc&) {
      goes_on = try_later(waiting, "no memory");
    }
  });
  if (!goes_on) end_reading(waiting);
}

void MapRunner::end_reading(const Continuations& waiting) {
  awaiting_images_.reset();
  for (const auto& then : std::exchange(*waiting, {})) guarded(then);
}

bool MapRunner::try_later(const Continuations& waiting, const std::string& why) {
  const auto delay = MapPersistence::delay_after(reads_failed_++);
  log_->warn("the images of the map {} cannot be read back, tried again in {} s: {}", published_->name,
             delay.count(), why);
  store_->later(
      [self = shared_from_this(), waiting] {
        self->queue_.post(
            [self, waiting] { self->read_on(waiting, [&] { return self->read_next_images(waiting); }); });
      },
      delay);
  return true;
}

bool MapRunner::read_next_images(const Continuations& waiting) {
  std::vector<KeyframeId> lacking = maker_->lacking_images();
  if (lacking.empty()) {
    listener_.paged(maker_->statistics());
    return false;
  }
  const auto rows = std::make_shared<ImageRows>();
  store_->read_images(published_->map, std::move(lacking),
                      [self = shared_from_this(), rows, waiting](ImageRows read) {
                        *rows = std::move(read);
                        self->queue_.post([self, rows, waiting] {
                          self->read_on(waiting, [&] { return self->page_in_images(rows, 0, waiting); });
                        });
                      });
  return true;
}

bool MapRunner::page_in_images(const std::shared_ptr<const ImageRows>& rows, size_t next,
                               const Continuations& waiting) {
  if (!*rows) {
    const Error& error = rows->error();
    if (!is_for_good(error)) return try_later(waiting, error.message);
    freeze(kUnreadable + error.message);
    return false;
  }
  reads_failed_ = 0;
  while (next < (*rows)->size()) {
    const ImageRow& row = (**rows)[next++];
    const GrayImagePtr image = decode_image_row(row.data);
    if (image == nullptr || !maker_->page_in_image(row.keyframe, image->view())) {
      freeze(kUnreadable + ("that of keyframe " + std::to_string(row.keyframe.value)) +
             " is not one of its camera's");
      return false;
    }
    if (stopping_ || waiting_offers_ > 0 || urgent_.urgent_waits()) break;
  }
  if (next == (*rows)->size()) return read_next_images(waiting);
  queue_.post([self = shared_from_this(), rows, next, waiting] {
    self->read_on(waiting, [&] { return self->page_in_images(rows, next, waiting); });
  });
  return true;
}

}  // namespace cairn
