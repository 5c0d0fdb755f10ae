// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "common/base/rate_limit.h"
#include "server/service/client.h"
#include "server/service/service_context.h"

namespace cairn {

/// The clients by name: those that are connected, and of those that have been here the latest. What each is
/// told of itself and of its commands goes through here. Used from the service's thread.
class Clients {
 public:
  explicit Clients(const ServiceContext& context) : context_(context) {}
  Clients(const Clients&) = delete;
  Clients& operator=(const Clients&) = delete;
  struct Listener {
    /// Called when a client is connected, and has been told its verdicts.
    std::function<void(Client& client)> came;
    /// Called when a client has gone, or is not remembered any more.
    std::function<void(const std::string& name)> left;
  };
  /// Sets the listener. To be called before anything else.
  void listen(Listener listener) { listener_ = std::move(listener); }

  /// The client of this name: a new one, if nobody was called so. Another that has long gone may be forgotten
  /// for it.
  [[nodiscard]] Client& of(const Principal& who);
  /// The client of this name, or this id; null: none is known.
  [[nodiscard]] Client* find(const std::string& name);
  [[nodiscard]] Client* find(ClientId id);
  [[nodiscard]] std::map<std::string, Client>& all() { return clients_; }
  [[nodiscard]] const std::map<std::string, Client>& all() const { return clients_; }

  /// Notes that a client listens: it is told its verdicts, then the listener is called.
  void connect(const Principal& who);
  /// Notes that a client listens no more.
  void disconnect(const Principal& who);
  /// Sets the names of all clients whose keys were revoked: what they have offered and nothing has judged yet
  /// is not taken any more.
  void turn_away(std::set<std::string> names);
  [[nodiscard]] const std::set<std::string>& turned_away() const { return turned_away_; }
  /// Writes into the audit log what a client has done.
  void note_done(const std::string& client, const std::string& action, const std::string& object) const;
  /// Writes into the audit log what a client may not do: once, and then now and then with how often.
  void note_refused(Client& client, const std::string& action, const std::string& object,
                    const std::string& why) const;
  /// Takes over what was decided before the server started: a client that sends a command again is answered.
  void resume(const std::vector<RestoredMap>& restored, const std::vector<DeletedDecisions>& deleted);

  /// Tells a client an event if it is connected; MapUnlisted also if it is not, since its readers of maps may
  /// still be there. What cannot be told is logged, now and then.
  void tell(const Client& client, const ClientEvent& event) { (void)try_to_tell(client, event); }
  /// tell() for callers that have to know whether it was told.
  [[nodiscard]] Status try_to_tell(const Client& client, const ClientEvent& event);
  /// Tells the status to all that are connected, and their verdicts again where a notice to another process
  /// has replaced them.
  void tell_status(const wire::ServerStatus& status);
  void write_verdicts(Client& client);
  /// Bytes of all that clients have offered and that has not been judged yet.
  [[nodiscard]] const WaitingBytes& waiting_bytes() const { return waiting_bytes_; }

 private:
  void forget_old(const std::string& keep);
  /// Why the client is not served; empty: it is.
  [[nodiscard]] std::string why_not_served(const Client& client) const;

  const ServiceContext& context_;
  Listener listener_;
  std::map<std::string, Client> clients_;
  std::map<ClientId, std::string> names_;
  std::set<std::string> turned_away_;  ///< their keys were revoked
  const WaitingBytes waiting_bytes_ = std::make_shared<std::atomic<size_t>>(0);
  RateLimit output_trouble_;
};

/// Notice to a process that an operator has ended.
inline constexpr const char* kKicked = "an operator has ended this; start the tracker again to go on";
/// Notice to a process that asks for lockstep where there is none.
inline constexpr const char* kNoLockstep =
    "this server does not work in lockstep, since that holds up all others; leave out --pace lockstep, or "
    "start cairn-server with --lockstep allow";

}  // namespace cairn
