// SPDX-License-Identifier: Apache-2.0
#include "hw/app/rig_loop.h"

#include <poll.h>

#include <algorithm>
#include <array>
#include <utility>

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kStatePeriod{10};
constexpr milliseconds kClosingTime{500};

/// Of the wall clock, which is that of stamps on the wire.
Timestamp wall_time() {
  return {std::chrono::duration_cast<std::chrono::nanoseconds>(
              std::chrono::system_clock::now().time_since_epoch())
              .count()};
}

}  // namespace

Result<std::unique_ptr<RigLoop>> RigLoop::start(const RigLoopOptions& options, std::unique_ptr<CanBus> bus,
                                                std::function<void()> told) {
  auto wake_up = WakeUp::create();
  if (!wake_up) return tl::unexpected(wake_up.error());
  std::unique_ptr<RigLoop> loop(new RigLoop(options, std::move(bus), std::move(told), *std::move(wake_up)));
  loop->thread_ = std::thread(&RigLoop::run, loop.get());
  return loop;
}

RigLoop::RigLoop(const RigLoopOptions& options, std::unique_ptr<CanBus> bus, std::function<void()> told,
                 WakeUp wake_up)
    : options_(options),
      bus_(std::move(bus)),
      told_(std::move(told)),
      wake_up_(std::move(wake_up)),
      bridge_(options_.configuration, options_.clock.now()),
      next_state_(options_.clock.now()) {}

RigLoop::~RigLoop() {
  ends_ = true;
  wake_up_.wake();
  thread_.join();
}

void RigLoop::post(wire::RigCommand command) {
  {
    const std::lock_guard lock(mutex_);
    commands_.push_back(std::move(command));
  }
  wake_up_.wake();
}

void RigLoop::stop() {
  stop_asked_ = true;
  wake_up_.wake();
}

std::optional<wire::RigState> RigLoop::take_state() {
  const std::lock_guard lock(mutex_);
  return std::exchange(state_, std::nullopt);
}

void RigLoop::run() {
  for (MonotonicTime now = options_.clock.now(); !is_over(now); now = options_.clock.now()) {
    turn(now);
    wait();
  }
}

/// What has come is taken before the rig looks at the time: it takes silence for death.
void RigLoop::turn(MonotonicTime now) {
  wake_up_.clear();
  if (stop_asked_.exchange(false)) bridge_.stop(now);
  while (const auto frame = bus_->receive()) bridge_.receive(*frame, now);
  std::vector<wire::RigCommand> commands;
  {
    const std::lock_guard lock(mutex_);
    commands.swap(commands_);
  }
  for (const wire::RigCommand& command : commands) {
    const auto age = std::chrono::nanoseconds(wall_time() - command.seen) / options_.clock.factor();
    bridge_.obey(command, now, now - std::chrono::duration_cast<MonotonicTime::duration>(age));
  }
  bridge_.advance(now);
  send();
  if (now >= next_state_) publish(now);
}

void RigLoop::send() {
  // What is withheld is not kept: the rig says again what matters until the drive obeys.
  for (const OutgoingFrame& out : bridge_.take_frames()) (void)bus_->send(out.frame, out.urgency);
}

void RigLoop::publish(MonotonicTime now) {
  next_state_ = std::max(next_state_ + kStatePeriod, now);
  wire::RigState state = bridge_.state(wall_time());
  tell_changes(state);
  {
    const std::lock_guard lock(mutex_);
    state_ = std::move(state);
  }
  told_();
}

void RigLoop::tell_changes(const wire::RigState& state) {
  const auto tell = [this](std::string* before, std::string now, const char* when_over) {
    if (now == *before) return;
    if (!now.empty()) {
      options_.log->warn("{}", now);
    } else if (when_over != nullptr) {
      options_.log->info("{}", when_over);
    }
    *before = std::move(now);
  };
  tell(&bus_trouble_, describe(bus_->health(), options_.interface_name), "the bus works again");
  tell(&trouble_, state.trouble, "nothing keeps the rig from moving any more");
  tell(&refusal_, state.refusal.empty() ? "" : "an order is refused: " + state.refusal, nullptr);
  std::string doing = std::string(name_of(state.mode));
  if (!state.commander.empty()) doing += ", commanded by " + state.commander;
  if (doing == doing_) return;
  options_.log->info("{}", doing);
  doing_ = std::move(doing);
}

void RigLoop::wait() {
  const std::array<pollfd, 2> asked = {pollfd{bus_->descriptor(), POLLIN, 0},
                                       pollfd{wake_up_.descriptor(), POLLIN, 0}};
  auto ready = asked;
  auto most = options_.clock.until(std::min(bridge_.next_due(), next_state_));
  if (const auto retry = bus_->retry_at()) {
    const auto left = *retry - std::chrono::steady_clock::now();
    most = std::clamp<std::chrono::nanoseconds>(left, std::chrono::nanoseconds(0), most);
  }
  const timespec limit{most.count() / 1'000'000'000, most.count() % 1'000'000'000};
  ppoll(ready.data(), ready.size(), &limit, nullptr);
}

bool RigLoop::is_over(MonotonicTime now) {
  if (!ends_) return false;
  if (!closing_until_) {
    closing_until_ = now + kClosingTime;
    bridge_.close(now);
  }
  return bridge_.is_let_go(now) || now >= *closing_until_;
}

}  // namespace cairn
