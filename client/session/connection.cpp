// SPDX-License-Identifier: Apache-2.0
#include "client/session/connection.h"

#include <chrono>
#include <utility>

#include "common/wire/partition.h"
#include "common/wire/security.h"

namespace cairn {
namespace {

/// Between two looks at the way to a silent server; the first comes that long after it fell silent.
constexpr std::chrono::milliseconds kLookInterval{1000};

}  // namespace

Result<std::unique_ptr<Connection>> Connection::open(SharedCore& core,
                                                     const wire::ParticipantOptions& options,
                                                     wire::ImageEncoding encoding, Network network,
                                                     Logger log) {
  std::unique_ptr<Connection> made(
      new Connection(core, options, encoding, std::move(network), std::move(log)));
  auto link = made->make_link();
  if (!link) return tl::unexpected(link.error());
  made->link_ = std::move(*link);
  made->path_ = made->link_->participant.path();
  made->path_watch_ = std::make_unique<PathWatch>(options.server_host, made->path_);
  made->thread_ = std::thread([me = made.get()] { me->watch(); });
  return made;
}

Connection::Connection(SharedCore& core, wire::ParticipantOptions options, wire::ImageEncoding encoding,
                       Network network, Logger log)
    : core_(core),
      options_(std::move(options)),
      encoding_(encoding),
      network_(std::move(network)),
      log_(std::move(log)) {}

Connection::~Connection() {
  {
    const std::scoped_lock lock(mutex_);
    closing_ = true;
  }
  for_watch_.notify_one();
  if (thread_.joinable()) thread_.join();
  take_down();
}

void Connection::map_changed() {
  const std::scoped_lock lock(mutex_);
  if (link_) link_->receiver->map_changed();
}

wire::Traffic Connection::traffic() const {
  const std::scoped_lock lock(mutex_);
  wire::Traffic all = past_traffic_;
  if (!link_) return all;
  const wire::Traffic now = link_->participant.traffic();
  all.bytes_sent += now.bytes_sent;
  all.bytes_received += now.bytes_received;
  return all;
}

wire::NetworkPath Connection::path() const {
  const std::scoped_lock lock(mutex_);
  return path_;
}

Result<std::unique_ptr<Connection::Link>> Connection::make_link() {
  auto participant = network_.join(options_);
  if (!participant) return tl::unexpected(participant.error());
  core_.stop(false);
  core_.apply([](SessionCore& core) { core.joined_anew(); });
  std::unique_ptr<Link> link(new Link{core_, *std::move(participant), nullptr, nullptr});
  const std::string name = core_.look([](const SessionCore& core) { return core.options().name; });
  auto receiver = Receiver::start(core_, memory_, link->participant, name, log_);
  if (!receiver) return tl::unexpected(receiver.error());
  link->receiver = std::move(*receiver);
  auto sender = Sender::start(core_, link->participant, wire::client_partition(name), encoding_, log_);
  if (!sender) return tl::unexpected(sender.error());
  link->sender = std::move(*sender);
  return link;
}

void Connection::take_down() {
  core_.stop(true);
  std::unique_ptr<Link> old;
  {
    const std::scoped_lock lock(mutex_);
    old = std::move(link_);
    if (!old) return;
    const wire::Traffic traffic = old->participant.traffic();
    past_traffic_.bytes_sent += traffic.bytes_sent;
    past_traffic_.bytes_received += traffic.bytes_received;
  }
}

void Connection::join_anew() {
  take_down();
  path_watch_->left();  // until that has succeeded, however it fails
  for (auto& [map, copy] : memory_.maps) copy.labels.orphan_all(std::chrono::steady_clock::now());
  auto link = make_link();
  if (!link) return log_->warn("cannot join anew yet: {}", link.error().message);
  const wire::NetworkPath path = (*link)->participant.path();
  path_watch_->joined(path);
  const std::scoped_lock lock(mutex_);
  link_ = std::move(*link);
  path_ = path;
}

bool Connection::is_silent() const {
  return core_.look([](const SessionCore& core) { return core.link() != ServerLink::kConnected; });
}

bool Connection::has_newer_keys() {
  if (options_.security.empty()) return false;
  const auto keys = wire::read_security(options_.security);
  if (!keys) {
    if (std::exchange(keys_trouble_, keys.error().message) != keys.error().message)
      log_->warn("{}", keys.error().message);
    return false;
  }
  keys_trouble_.clear();
  const std::scoped_lock lock(mutex_);
  return link_ && keys->expires > link_->participant.good_until();
}

void Connection::watch() {
  bool was_silent = false;
  std::unique_lock lock(mutex_);
  while (!for_watch_.wait_for(lock, kLookInterval, [this] { return closing_; })) {
    lock.unlock();
    try {
      const bool silent = is_silent();
      if (!silent) path_watch_->heard();
      if (silent && was_silent) look_for_a_way();
      was_silent = silent;
    } catch (const std::exception& error) {  // the tracker goes on in the map that it has
      if (warning_.due()) log_->error("joining the server anew failed: {}", error.what());
    }
    lock.lock();
  }
}

/// The server is silent: by another network, or with keys that were renewed, it may be heard.
void Connection::look_for_a_way() {
  const PathWatch::Advice advice = path_watch_->compare(network_.find_path(options_));
  if (!advice.text.empty()) log_->warn("{}", advice.text);
  const bool has_renewed = has_newer_keys();
  if (has_renewed) log_->info("the keys of {} were renewed: joining anew with them", options_.security);
  if (advice.join_anew || has_renewed) join_anew();
}

}  // namespace cairn
