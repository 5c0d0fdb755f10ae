// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "common/wire/messages.h"
#include "common/wire/peers.h"
#include "server/service/clients.h"
#include "server/service/presence.h"
#include "server/service/served_maps.h"
#include "server/service/wearer_rule.h"

namespace cairn {

/// Which process speaks for each client's name, and what its tracker says of itself: its commands count, its
/// cameras are meant, and it narrows the answers to who wears it. Used from the service's thread.
class Sessions {
 public:
  Sessions(const ServiceContext& context, Clients& clients, ServedMaps& maps)
      : context_(context), clients_(clients), maps_(maps), wearers_(context.options.wearers) {}
  Sessions(const Sessions&) = delete;
  Sessions& operator=(const Sessions&) = delete;

  /// Takes a tracker's word on itself. Returns whether it counts: another live process may hold the name.
  bool hear(const Principal& who, wire::PublicationHandle publication, std::optional<wire::PeerId> process,
            const wire::TrackerStateMessage& message);
  /// Takes a camera that a process announces under this name; several processes may do so.
  void announce(const Principal& who, wire::PeerId process, const wire::CameraMessage& camera);
  /// Whether a command of this session is of the process that holds the name.
  [[nodiscard]] bool holds(const Client& client, SessionId session) const {
    return presence_.holds(client.name, session);
  }
  /// Whether this server does not serve the client since it works in lockstep, which holds up who else waits
  /// for a worker; then it is told.
  [[nodiscard]] bool refuses_lockstep(Client& client, bool lockstep);

  /// Notes that the client's process is not heard any more.
  void fell_silent(ClientId id);
  /// Notes that the client is not there any more.
  void left(const std::string& name);
  /// Ends the service of the process that holds the name now; another may come. Error kNotFound.
  [[nodiscard]] Status kick(const std::string& name);

  /// Number of clients that are heard.
  [[nodiscard]] int live_count(MonotonicTime now) const { return presence_.live_count(now); }
  [[nodiscard]] WearerRule& wearers() { return wearers_; }
  [[nodiscard]] const WearerRule& wearers() const { return wearers_; }

 private:
  void tell_intruder(Client& client, SessionId session, MonotonicTime now);
  void tell_kicked(Client& client);

  const ServiceContext& context_;
  Clients& clients_;
  ServedMaps& maps_;
  Presence presence_;
  WearerRule wearers_;
};

/// Whether what a tracker said last still holds.
[[nodiscard]] inline bool is_fresh(const Client::Word& word, MonotonicTime now) {
  return now - word.at < Presence::kSilence;
}

/// Whether a command whose camera is not known should be left until it is sent again: commands and cameras
/// are not in order with each other.
[[nodiscard]] bool may_yet_come(Client& client, MonotonicTime now);
/// Message about a camera that has not been announced.
[[nodiscard]] std::string unknown_camera(uint32_t camera, uint32_t version);

}  // namespace cairn
