// SPDX-License-Identifier: Apache-2.0
#include "hw/app/rig_loop.h"

#include <poll.h>

#include <algorithm>
#include <array>
#include <exception>
#include <utility>

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kStatePeriod{10};
constexpr milliseconds kClosingTime{500};
constexpr milliseconds kFailureWait{1};  // so that a turn that always fails leaves others the processor
constexpr size_t kGyroSamples = 4000;    // where nobody asks for them: some seconds

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
      next_state_(options_.clock.now()) {
  if (options_.reserved_for) bridge_.reserve_for(*options_.reserved_for);
}

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

void RigLoop::set_camera_clock(const wire::RigCameraClock& clock) {
  const std::lock_guard lock(mutex_);
  camera_clock_ = clock;
}

std::vector<GyroSample> RigLoop::take_gyro() {
  const std::lock_guard lock(mutex_);
  return std::exchange(gyro_, {});
}

void RigLoop::run() {
  while (true) {
    try {
      const MonotonicTime now = options_.clock.now();
      if (is_over(now)) return;
      turn(now);
      wait();
    } catch (const std::exception& error) {
      if (failure_told_.due())
        options_.log->error("rig {}: a turn of its loop failed: {}; if this repeats, restart cairn-rig",
                            options_.configuration.name, error.what());
      std::this_thread::sleep_for(kFailureWait);
    }
  }
}

/// One turn of the loop. Takes what has come before the rig looks at the time, for the rig takes silence for
/// death.
void RigLoop::turn(MonotonicTime now) {
  wake_up_.clear();
  if (stop_asked_.exchange(false)) stop_now(now);
  while (auto frame = bus_->receive()) {
    frame->stamp = options_.clock.of_wall(frame->stamp);
    bridge_.receive(*frame, now);
  }
  std::optional<wire::RigCameraClock> camera_clock;
  {
    const std::lock_guard lock(mutex_);
    camera_clock.swap(camera_clock_);
  }
  if (camera_clock) bridge_.set_camera_clock(*camera_clock);
  // Not those that come meanwhile: a flood of them must not keep the rig from its next step.
  for (size_t left = commands_waiting(); left > 0; --left) {
    if (const auto command = take_command()) bridge_.obey(*command, now, options_.clock.at(command->seen));
  }
  bridge_.advance(now);
  send();
  if (now >= next_state_) publish(now);
}

/// Carries an emergency stop out. One that fails is asked for again.
void RigLoop::stop_now(MonotonicTime now) {
  try {
    bridge_.stop(now);
  } catch (...) {
    stop_asked_ = true;
    throw;
  }
}

size_t RigLoop::commands_waiting() {
  const std::lock_guard lock(mutex_);
  return commands_.size();
}

/// Takes one order at a time: a fault of one is no fault of those that came with it.
std::optional<wire::RigCommand> RigLoop::take_command() {
  const std::lock_guard lock(mutex_);
  if (commands_.empty()) return std::nullopt;
  std::optional<wire::RigCommand> command(std::move(commands_.front()));
  commands_.pop_front();
  return command;
}

void RigLoop::send() {
  // What is withheld is not kept: the rig says again what matters until the drive obeys.
  for (const OutgoingFrame& out : bridge_.take_frames()) (void)bus_->send(out.frame, out.urgency);
}

void RigLoop::publish(MonotonicTime now) {
  next_state_ = std::max(next_state_ + kStatePeriod, now);
  const std::string bus_trouble = describe(bus_->health(), options_.interface_name);
  bridge_.set_bus_trouble(bus_trouble);
  wire::RigState state = bridge_.state(options_.clock.wall_time());
  tell_changes(state, bus_trouble);
  tell_strange_frames();
  collect_gyro();
  {
    const std::lock_guard lock(mutex_);
    state_ = std::move(state);
  }
  told_();
}

/// Tells of strange frames. They are not taken, and that is all; a device that sends nothing else falls
/// silent.
void RigLoop::tell_strange_frames() {
  const uint64_t count = bridge_.rig().counters().strange_frames;
  if (count == strange_frames_ || !strange_told_.due()) return;
  strange_frames_ = count;
  options_.log->warn("{}; it is not taken ({} such frames so far)", bridge_.rig().describe_strange(), count);
}

void RigLoop::collect_gyro() {
  std::vector<GyroSample> samples = bridge_.take_gyro();
  for (GyroSample& sample : samples)
    sample.when = {options_.clock.at(sample.when).time_since_epoch().count()};
  const std::lock_guard lock(mutex_);
  if (gyro_.size() > kGyroSamples) gyro_.clear();
  gyro_.insert(gyro_.end(), samples.begin(), samples.end());
}

void RigLoop::tell_changes(const wire::RigState& state, const std::string& bus_trouble) {
  const auto tell = [this](std::string* before, const std::string& now, const char* when_over) {
    if (now == *before) return;
    if (!now.empty()) {
      options_.log->warn("{}", now);
    } else if (when_over != nullptr) {
      options_.log->info("{}", when_over);
    }
    *before = now;
  };
  tell(&bus_trouble_, bus_trouble, "the bus works again");
  tell(&trouble_, bridge_.rig().describe(), "nothing keeps the rig from moving any more");
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
  return now >= *closing_until_ || bridge_.is_let_go(now);
}

}  // namespace cairn
