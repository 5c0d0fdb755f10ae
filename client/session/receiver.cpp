// SPDX-License-Identifier: Apache-2.0
#include "client/session/receiver.h"

#include <algorithm>
#include <deque>
#include <utility>

#include "common/wire/partition.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kPollInterval{100};  // liveliness is polled: it has no message

}  // namespace

Result<std::unique_ptr<Receiver>> Receiver::start(SharedCore& core, ReceiverMemory& memory,
                                                  const wire::Participant& participant,
                                                  const std::string& client_name, Logger log) {
  auto readers =
      wire::create_all<wire::Reader<wire::ServerStatus>, wire::Reader<wire::MapInfo>,
                       wire::Reader<wire::SeedVerdict>, wire::Reader<wire::OfferVerdict>,
                       wire::Reader<wire::RelocAnswer>, wire::Reader<wire::CameraEstimate>,
                       wire::Reader<wire::ClientReply>>(participant, wire::client_partition(client_name));
  if (!readers) return tl::unexpected(readers.error());
  auto& [status, maps, seeds, offers, places, cameras, replies] = *readers;
  auto waiter = wire::Waiter::create(participant);
  if (!waiter) return tl::unexpected(waiter.error());
  if (Status attached = waiter->attach({status, maps, seeds, offers, places, cameras, replies}); !attached) {
    return tl::unexpected(attached.error());
  }
  return std::unique_ptr<Receiver>(
      new Receiver(core, memory, participant, client_name,
                   {std::move(status), std::move(maps), std::move(seeds), std::move(offers),
                    std::move(places), std::move(cameras), std::move(replies)},
                   std::move(*waiter), std::move(log)));
}

Receiver::Receiver(SharedCore& core, ReceiverMemory& memory, wire::Participant participant,
                   std::string client_name, ServerReaders readers, wire::Waiter waiter, Logger log)
    : core_(core),
      memory_(memory),
      participant_(std::move(participant)),
      client_name_(std::move(client_name)),
      server_(std::move(readers)),
      waiter_(std::move(waiter)),
      log_(std::move(log)),
      thread_([this] { run(); }) {}

Receiver::~Receiver() {
  waiter_.wake();
  thread_.join();
}

void Receiver::run() {
  while (true) {
    waiter_.wait(time_to_wait());
    if (core_.is_stopping()) return;
    try {
      take_server_messages();
      follow_recent_maps();
      for (auto& [map, channel] : channels_) {
        ReceiverMemory::MapCopy& copy = memory_.maps.at(map);
        take_map_messages(channel, copy);
        take_labels(channel, copy);
      }
    } catch (const std::exception& error) {  // nothing that a peer sends may end the tracker
      if (warning_.due()) log_->error("what the server sent could not be used: {}", error.what());
    }
  }
}

milliseconds Receiver::time_to_wait() const {
  milliseconds wait = kPollInterval;
  for (const auto& [map, copy] : memory_.maps) {
    if (!copy.replica.deadline()) continue;
    const auto left = *copy.replica.deadline() - std::chrono::steady_clock::now();
    wait = std::clamp(std::chrono::ceil<milliseconds>(left), milliseconds(0), wait);
  }
  return wait;
}

template <typename Message>
void Receiver::pass_on(wire::Reader<Message>& reader) {
  wire::take_all(reader, [this](wire::Sample<Message>& sample) {
    if (sample.message) core_.apply([&](SessionCore& core) { core.take(std::move(*sample.message)); });
  });
}

void Receiver::take_server_messages() {
  pass_on(server_.status);
  wire::take_all(server_.maps, [this](const wire::Sample<wire::MapInfo>& sample) {
    core_.apply([&](SessionCore& core) {
      if (sample.message) {
        core.take(*sample.message);
      } else if (sample.gone == wire::Gone::kDisposed) {
        core.take_unlisted(sample.key.map);
      }
    });
  });
  pass_on(server_.seeds);
  pass_on(server_.offers);
  pass_on(server_.places);
  wire::take_all(server_.cameras, [this](const wire::Sample<wire::CameraEstimate>& sample) {
    core_.apply([&](SessionCore& core) {
      if (sample.message) {
        core.take(*sample.message);
      } else if (sample.gone == wire::Gone::kDisposed) {
        core.take_forgotten(sample.key);
      }
    });
  });
  pass_on(server_.replies);
  const bool is_alive = server_.status.alive_writers() > 0;
  core_.apply([&](SessionCore& core) { core.take_presence(is_alive); });
}

void Receiver::follow_recent_maps() {
  const std::deque<MapId> wanted = core_.look([](const SessionCore& core) { return core.maps().recent(); });
  const auto is_unwanted = [&](const auto& entry) {
    return std::find(wanted.begin(), wanted.end(), entry.first) == wanted.end();
  };
  std::erase_if(channels_, is_unwanted);
  std::erase_if(memory_.maps, is_unwanted);
  for (const MapId& map : wanted) {
    if (channels_.contains(map)) continue;
    Result<MapChannel> channel = open_channel(map);
    if (!channel) {  // the next turn asks for it again
      if (warning_.due()) log_->error("a map cannot be received: {}", channel.error().message);
      return;
    }
    memory_.maps.try_emplace(map, map);
    channels_.emplace(map, std::move(*channel));
  }
}

Result<Receiver::MapChannel> Receiver::open_channel(MapId map) {
  auto readers = wire::create_all<wire::Reader<wire::PointPatches>, wire::Reader<wire::PointPositions>,
                                  wire::Reader<wire::KeyframePoses>, wire::Reader<wire::MapCommit>,
                                  wire::Reader<wire::LabelMessage>>(participant_,
                                                                    wire::map_partition(client_name_, map));
  if (!readers) return tl::unexpected(readers.error());
  auto& [patches, positions, keyframes, commits, labels] = *readers;
  if (Status attached = waiter_.attach({patches, positions, keyframes, commits, labels}); !attached) {
    return tl::unexpected(attached.error());
  }
  return MapChannel{std::move(patches), std::move(positions), std::move(keyframes), std::move(commits),
                    std::move(labels)};
}

void Receiver::take_map_messages(MapChannel& channel, ReceiverMemory::MapCopy& copy) {
  Replica& replica = copy.replica;
  const auto receive = [&replica](auto& sample) {
    if (sample.message) replica.receive(std::move(*sample.message));
  };
  wire::take_all(channel.patches, receive);
  wire::take_all(channel.positions, receive);
  wire::take_all(channel.keyframes, receive);
  wire::take_all(channel.commits, receive);
  copy.snapshot_due |= replica.update(std::chrono::steady_clock::now());
  if (!copy.snapshot_due) return;
  copy.snapshot_due = !core_.apply([&](SessionCore& core) { return core.take(replica.snapshot()); });
}

}  // namespace cairn
