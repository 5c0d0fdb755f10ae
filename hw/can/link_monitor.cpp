// SPDX-License-Identifier: Apache-2.0
#include "hw/can/link_monitor.h"

#include <algorithm>
#include <cerrno>

namespace cairn {
namespace {

/// A controller that receives for so long without a further error is error-active again. Not every driver
/// says so, and each frame that is received well lowers its counter.
constexpr std::chrono::seconds kPassiveMemory{1};

}  // namespace

void Backoff::failed(MonotonicTime now) {
  if (retry_at_ && now < *retry_at_) return;
  retry_at_ = now + next_;
  next_ = std::min(2 * next_, longest_);
}

void Backoff::succeeded() {
  next_ = first_;
  retry_at_.reset();
}

void LinkMonitor::sent() {
  ++health_.sent;
  queue_full_ = false;
  queue_backoff_.succeeded();
  link_works();
}

void LinkMonitor::received(MonotonicTime now) {
  ++health_.received;
  // A controller that is bus-off receives nothing.
  const bool calm = now - last_error_frame_ >= kPassiveMemory;
  if (controller_ == Controller::kBusOff || (controller_ == Controller::kPassive && calm)) {
    controller_ = Controller::kActive;
  }
  link_works();
}

void LinkMonitor::lost_so_far(uint32_t count) {
  health_.lost += count - lost_count_;
  lost_count_ = count;
}

void LinkMonitor::noticed(const BusErrors& errors, MonotonicTime now) {
  ++health_.error_frames;
  health_.last_errors = errors;
  if (errors.has(BusFault::kArbitrationLost)) ++health_.arbitration_lost;
  if (errors.has(BusFault::kNoAcknowledge)) ++health_.no_acknowledge;
  if (errors.has(BusFault::kErrorActive) || errors.has(BusFault::kRestarted)) {
    controller_ = Controller::kActive;
  }
  if (errors.has(BusFault::kErrorPassive) && controller_ != Controller::kBusOff) {
    controller_ = Controller::kPassive;
  }
  if (errors.has(BusFault::kBusOff) && controller_ != Controller::kBusOff) {
    controller_ = Controller::kBusOff;
    ++health_.bus_off;
  }
  last_error_frame_ = now;
  update();
}

void LinkMonitor::send_failed(int error, MonotonicTime now) {
  withheld();
  if (error != ENOBUFS && error != EAGAIN) {
    // Whoever sends all the time must not put off the next look at the interface.
    if (link_ == BusCondition::kUp) link_backoff_.failed(now);
    return note_link_error(error);
  }
  // A driver whose controller is bus-off takes nothing either: that is no full queue.
  if (controller_ != Controller::kBusOff) {
    queue_full_ = true;
    queue_backoff_.failed(now);
  }
  update();
}

void LinkMonitor::link_failed(int error, MonotonicTime now) {
  link_backoff_.failed(now);
  note_link_error(error);
}

void LinkMonitor::note_link_error(int error) {
  link_error_ = 0;
  if (error == ENETDOWN) {
    link_ = BusCondition::kInterfaceDown;
  } else if (error == ENODEV || error == ENXIO) {
    link_ = BusCondition::kInterfaceGone;
  } else {
    link_ = BusCondition::kFault;
    link_error_ = error;
  }
  // An interface begins anew with its controller active and its queue empty.
  controller_ = Controller::kActive;
  queue_full_ = false;
  queue_backoff_.succeeded();
  update();
}

void LinkMonitor::link_works() {
  if (link_ != BusCondition::kUp) {
    ++health_.restored;
    link_ = BusCondition::kUp;
    link_error_ = 0;
    link_backoff_.succeeded();
  }
  update();
}

bool LinkMonitor::may_send(MonotonicTime now) const {
  return controller_ != Controller::kBusOff && link_backoff_.due(now) && queue_backoff_.due(now);
}

void LinkMonitor::update() {
  health_.system_error = link_error_;
  if (link_ != BusCondition::kUp) {
    health_.condition = link_;
  } else if (controller_ == Controller::kBusOff) {
    health_.condition = BusCondition::kBusOff;
  } else if (queue_full_) {
    health_.condition = BusCondition::kQueueFull;
  } else if (controller_ == Controller::kPassive) {
    health_.condition = BusCondition::kErrorPassive;
  } else {
    health_.condition = BusCondition::kUp;
  }
}

}  // namespace cairn
