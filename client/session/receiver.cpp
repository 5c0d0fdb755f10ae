// SPDX-License-Identifier: Apache-2.0
#include "client/session/receiver.h"

#include <algorithm>
#include <random>
#include <tuple>
#include <utility>

#include "common/geometry/camera_guess.h"
#include "common/wire/partition.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kPollInterval{100};  // liveliness is polled: it has no message

}  // namespace

SessionId random_session() {
  std::random_device device;
  const uint64_t high = device();
  return {(high << 32 | device()) | 1};
}

Result<std::unique_ptr<Receiver>> Receiver::start(SessionState& state, ReceiverMemory& memory,
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
      new Receiver(state, memory, participant, client_name,
                   {std::move(status), std::move(maps), std::move(seeds), std::move(offers),
                    std::move(places), std::move(cameras), std::move(replies)},
                   std::move(*waiter), std::move(log)));
}

Receiver::Receiver(SessionState& state, ReceiverMemory& memory, wire::Participant participant,
                   std::string client_name, ServerReaders readers, wire::Waiter waiter, Logger log)
    : state_(state),
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
    {
      const std::scoped_lock lock(state_.mutex);
      if (state_.stopping) return;
    }
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

void Receiver::take_server_messages() {
  wire::take_all(server_.status, [this](const wire::Sample<wire::ServerStatus>& sample) {
    if (!sample.message) return;
    const std::scoped_lock lock(state_.mutex);
    act_on(state_.monitor.heard(sample.message->server, sample.message->start_count));
  });
  wire::take_all(server_.maps, [this](const wire::Sample<wire::MapInfo>& sample) {
    const std::scoped_lock lock(state_.mutex);
    if (sample.message) {
      state_.monitor.map_listed(sample.message->map, sample.message->server);
      memory_.directory.listed(sample.message->map, sample.message->name);
      state_.terms[sample.message->map] = {sample.message->right, sample.message->takes_proposals};
    } else if (sample.gone == wire::Gone::kDisposed) {
      state_.monitor.map_removed(sample.key.map);
      memory_.directory.removed(sample.key.map);
      state_.terms.erase(sample.key.map);
    }
  });
  wire::take_all(server_.seeds, [this](const wire::Sample<wire::SeedVerdict>& sample) {
    if (sample.message) act_on(*sample.message);
  });
  wire::take_all(server_.offers, [this](const wire::Sample<wire::OfferVerdict>& sample) {
    if (sample.message) act_on(*sample.message);
  });
  wire::take_all(server_.places, [this](wire::Sample<wire::RelocAnswer>& sample) {
    if (sample.message) act_on(std::move(*sample.message));
  });
  wire::take_all(server_.cameras, [this](const wire::Sample<wire::CameraEstimate>& sample) {
    if (sample.message) {
      act_on(*sample.message);
    } else if (sample.gone == wire::Gone::kDisposed) {
      forget_camera(sample.key);
    }
  });
  wire::take_all(server_.replies, [this](const wire::Sample<wire::ClientReply>& sample) {
    if (sample.message) act_on(*sample.message);
  });
  const bool is_alive = server_.status.alive_writers() > 0;
  const std::scoped_lock lock(state_.mutex);
  act_on(state_.monitor.alive(is_alive));
  if (!state_.options.only_map.empty() && !state_.map_in_use) {
    state_.choose_map(memory_.directory.find(state_.options.only_map, state_.monitor));
  }
}

void Receiver::act_on(LinkMonitor::Event event) {
  using Event = LinkMonitor::Event;
  if (event == Event::kNone) return;
  if (event == Event::kRestarted) {
    log_->warn("the server has been started anew");
    state_.restarted = true;
    state_.session_id = random_session();
    state_.commands.clear();
    state_.seed.restart(state_.session_id);
    state_.question.restart(state_.session_id);
    for (RequestReply& reply : state_.requests.restart(state_.session_id, kRestartedText)) {
      state_.request_replies.push_back(std::move(reply));
    }
    for (OfferReply& reply : state_.spool.restart(state_.session_id, kRestartedText)) {
      state_.offer_replies.push_back(std::move(reply));
    }
  } else if (event == Event::kGone) {
    log_->debug("the server is gone");  // status() says so, and what it means for the tracker
    state_.question.restart(state_.session_id);
  } else {
    log_->info("connected to {}", state_.options.server);
    state_.spool.resend_all();
    state_.requests.resend_all();
    state_.seed.resend();
  }
  state_.tracker_changed = true;
  state_.for_sender.notify_one();
  state_.for_waiters.notify_all();
}

void Receiver::act_on(const wire::SeedVerdict& verdict) {
  const std::scoped_lock lock(state_.mutex);
  if (!state_.seed.apply(verdict)) return;
  if (verdict.accepted) {
    state_.seed_reply = SeedReply{
        SeedAnswer{verdict.map, verdict.epoch, verdict.revision, verdict.second_keyframe, verdict.points},
        {}};
    state_.choose_map(verdict.map);
    state_.own_map = verdict.map;
    state_.monitor.map_listed(verdict.map, state_.monitor.server());
    state_.require({verdict.map, verdict.epoch, verdict.revision});
  } else {
    state_.seed_reply = SeedReply{std::nullopt, verdict.reason};
  }
  state_.for_waiters.notify_all();
}

void Receiver::act_on(const wire::OfferVerdict& verdict) {
  const std::scoped_lock lock(state_.mutex);
  if (verdict.session != state_.session_id) return;
  // Sequence 0 is no offer: the server tells why it does not serve this process at all.
  const auto notice = std::find_if(verdict.recent.begin(), verdict.recent.end(),
                                   [](const wire::OfferOutcome& outcome) { return outcome.seq == 0; });
  const std::string refusal = notice == verdict.recent.end() ? "" : notice->reason;
  if (refusal != state_.refusal) {
    if (!refusal.empty()) log_->warn("the server does not serve us: {}", refusal);
    state_.refusal = refusal;
    state_.seed.resend();  // what went unheard while we were refused
    state_.spool.resend_all();
    state_.requests.resend_all();
  }
  state_.name_held = refusal.empty();
  for (OfferReply& reply : state_.spool.apply(verdict)) state_.offer_replies.push_back(std::move(reply));
  if (!verdict.recent.empty() && verdict.recent.back().revision) {
    const wire::OfferOutcome& newest = verdict.recent.back();
    state_.require({newest.map, newest.epoch, newest.revision});
  }
  state_.for_sender.notify_one();  // there may be credit again
  state_.for_waiters.notify_all();
}

void Receiver::act_on(wire::RelocAnswer&& answer) {
  const std::scoped_lock lock(state_.mutex);
  if (!state_.question.apply(answer)) return;
  PlaceAnswer& place = state_.place_answer.emplace(std::move(answer.answer));
  if (!state_.options.only_map.empty()) {
    std::erase_if(place.candidates, [&](const PlaceCandidate& c) { return c.map != state_.map_in_use; });
    if (place.candidates.empty()) place.verdict = PlaceVerdict::kNotKnown;
  }
  state_.for_waiters.notify_all();
}

/// Of a camera whose values we take for exact nobody needs to tell us.
void Receiver::act_on(const wire::CameraEstimate& estimate) {
  const std::scoped_lock lock(state_.mutex);
  if (state_.options.camera_sigma.empty() || estimate.client != state_.client ||
      estimate.camera != state_.camera.camera)
    return;
  const CameraParameters& ours = state_.camera.parameters;
  const CameraParameters& theirs = estimate.parameters;
  const auto doubt = doubtful_camera(theirs, estimate.sigma);
  const auto camera = make_camera(theirs);
  if (!doubt || !camera || theirs.width != ours.width || theirs.height != ours.height) {
    state_.unsound_cameras.insert(estimate.map);
    if (warning_.due()) log_->warn("what a map says of the camera cannot be: it is not used");
    return;
  }
  state_.unsound_cameras.erase(estimate.map);
  auto& kept = state_.found_out[estimate.map];
  if (!kept.empty() &&
      std::tie(estimate.epoch, estimate.version) <= std::tie(kept.back().epoch, kept.back().news.version))
    return;  // a repetition, or a late word of a server that has died
  if (kept.size() == SessionState::kEstimatesKept) kept.pop_front();
  kept.push_back({estimate.epoch,
                  {estimate.version, *camera, doubt->focal_sigma, doubt->k1_sigma, estimate.frozen,
                   estimate.cannot_be_known}});
}

void Receiver::forget_camera(const wire::CameraEstimate& key) {
  const std::scoped_lock lock(state_.mutex);
  if (key.client != state_.client || key.camera != state_.camera.camera) return;
  state_.found_out.erase(key.map);
  state_.unsound_cameras.erase(key.map);
}

/// A server of before cameras were found out ignores that ours is a guess.
void Receiver::check_that_camera_is_found_out(const MapSnapshot& first) {
  state_.own_map = {};
  if (state_.camera.frozen || state_.our_camera_in(first) != nullptr) return;
  log_->warn(
      "this server does not find cameras out: its map takes what is believed of ours for exact; pass "
      "--calibration FILE, exact:FILE where it has no distortion");
}

void Receiver::follow_recent_maps() {
  std::vector<MapId> wanted;
  {
    const std::scoped_lock lock(state_.mutex);
    wanted.assign(state_.recent_maps.begin(), state_.recent_maps.end());
  }
  const auto is_unwanted = [&](const auto& entry) {
    return std::find(wanted.begin(), wanted.end(), entry.first) == wanted.end();
  };
  std::erase_if(channels_, is_unwanted);
  std::erase_if(memory_.maps, is_unwanted);
  for (const MapId& map : wanted) {
    if (channels_.contains(map)) continue;
    Result<MapChannel> channel = open_channel(map);
    if (!channel) {  // tried again soon
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
  const std::scoped_lock lock(state_.mutex);
  if (std::find(state_.recent_maps.begin(), state_.recent_maps.end(), replica.map()) ==
      state_.recent_maps.end())
    return;
  if (!state_.has_camera_of(*replica.snapshot())) return;
  copy.snapshot_due = false;
  state_.replicas[replica.map()] = replica.snapshot();
  if (replica.map() == state_.own_map) check_that_camera_is_found_out(*replica.snapshot());
  if (replica.map() != state_.map_in_use) return;
  state_.snapshot = replica.snapshot();
  state_.tracker_changed = true;  // the server waits to hear that this revision is in use
  state_.for_sender.notify_one();
  state_.for_waiters.notify_all();
}

}  // namespace cairn
