// SPDX-License-Identifier: Apache-2.0
#include "server/service/sessions.h"

#include <utility>

namespace cairn {
namespace {

constexpr std::chrono::seconds kNoticeInterval{1};
constexpr std::chrono::seconds kCameraGrace{3};

}  // namespace

bool may_yet_come(Client& client, MonotonicTime now) {
  if (!client.camera_missed_at) client.camera_missed_at = now;
  return now - *client.camera_missed_at < kCameraGrace;
}

std::string unknown_camera(uint32_t camera, uint32_t version) {
  return "camera " + std::to_string(camera) + " in version " + std::to_string(version) +
         " is not known here: not announced, or refused (the server's log says why)";
}

void Sessions::announce(const Principal& who, wire::PeerId process, const wire::CameraMessage& camera) {
  Client& client = clients_.of(who);
  const MonotonicTime now = context_.now();
  const Status taken = client.cameras.put(process, camera, now);
  if (taken) client.camera_missed_at.reset();
  if (!taken && client.camera_warning.due(now))
    context_.log->warn("{}: camera {} refused: {}", client.name, camera.camera, taken.error().message);
}

bool Sessions::hear(const Principal& who, wire::PublicationHandle publication,
                    std::optional<wire::PeerId> process, const wire::TrackerStateMessage& message) {
  Client& client = clients_.of(who);
  const MonotonicTime now = context_.now();
  // As Presence::heard() has it: after a new match its publication is another.
  const bool is_holder =
      presence_.holds(client.name, message.session) || presence_.is_holder(client.name, publication);
  ClientRates& rates = is_holder ? client.rates : client.others_rates;
  if (rates.judge(ClientRates::Kind::kState, now) != ClientRates::Judgement::kTake) return false;
  if (client.kicked == message.session) {
    tell_kicked(client);
    return false;
  }
  switch (presence_.heard(client.name, message.session, publication, now)) {
    case Presence::Standing::kIntruder:
      tell_intruder(client, message.session, now);
      return false;
    case Presence::Standing::kNewHolder:
      client.offer_gate.enter_session(message.session);
      client.seed_gate.enter_session(message.session);
      client.request_gate.enter_session(message.session);
      client.camera_missed_at.reset();
      client.lockstep_refused = false;
      clients_.write_verdicts(client);
      break;
    case Presence::Standing::kHolder:
      break;
  }
  if (process) client.cameras.set_holder(*process);
  const bool is_verified = message.state == TrackingState::kTracking || message.state == TrackingState::kPoor;
  // A replica outlives its map, and anybody may name one that never was: neither narrows the answers to
  // others.
  MapEntry* entry = maps_.array().find(message.map);
  const bool is_here =
      is_verified && entry != nullptr && context_.access().may_read(client.principal(), message.map);
  client.last_word = {message.session, message.state, message.map, message.quality, is_here, now};
  if (is_here) entry->localized_at = context_.wall();
  wearers_.heard(client.name, {message.wearer, is_here ? message.map : MapId{}, message.frame_time}, now);
  maps_.young().heard(client.name, {message.session, message.state, message.map, message.frame_time}, now);
  return true;
}

bool Sessions::refuses_lockstep(Client& client, bool lockstep) {
  if (!lockstep || context_.options.lockstep) return false;
  if (!std::exchange(client.lockstep_refused, true)) {
    context_.log->warn("{}: refused: {}", client.name, kNoLockstep);
    clients_.write_verdicts(client);
  }
  return true;
}

void Sessions::fell_silent(ClientId id) {
  const Client* client = clients_.find(id);
  if (client == nullptr) return;
  context_.log->debug("{}: its tracker has fallen silent", client->name);
  presence_.gone(client->name);
  wearers_.left(client->name);
}

void Sessions::left(const std::string& name) {
  presence_.gone(name);
  wearers_.left(name);
  maps_.young().left(name);
}

Status Sessions::kick(const std::string& name) {
  Client* client = clients_.find(name);
  if (client == nullptr || !client->connected || !client->last_word)
    return fail(ErrorCode::kNotFound,
                "client '" + name + "' is not connected; `cairnctl clients` lists them");
  client->kicked = client->last_word->session;
  client->last_word.reset();
  left(name);
  tell_kicked(*client);
  return {};
}

void Sessions::tell_kicked(Client& client) {
  const MonotonicTime now = context_.now();
  if (client.intruder_told_at && now - *client.intruder_told_at < Presence::kSilence) return;
  client.intruder_told_at = now;
  clients_.tell(client, wire::OfferVerdict{client.id, *client.kicked, 0, 0, {notice_to_process(kKicked)}});
  client.repeat_verdicts = true;
}

void Sessions::tell_intruder(Client& client, SessionId session, MonotonicTime now) {
  if (client.intruder_told_at && now - *client.intruder_told_at < kNoticeInterval) return;
  client.intruder_told_at = now;
  const std::string reason = "another live process is called '" + client.name + "'; choose another --name";
  if (std::exchange(client.intruder, session) != session)
    context_.log->warn("{}: a second process under this name is refused", client.name);
  if (!client.connected) return;
  clients_.tell(client, wire::OfferVerdict{client.id, session, 0, 0, {notice_to_process(reason)}});
  client.repeat_verdicts = true;
}

}  // namespace cairn
