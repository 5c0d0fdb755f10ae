// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "common/base/log.h"
#include "common/base/result.h"

namespace cairn::wire {

/// The network is a star: the server stands at a known port and has no peers; clients have the server as
/// their only peer.
enum class Role : uint8_t { kServer, kClient };

constexpr uint32_t kMaxDomain = 230;  ///< ports are 7400 + 250 * domain + ...; 16 bits end there

struct ParticipantOptions {
  uint32_t domain = 0;
  Role role = Role::kClient;
  std::string server_host = "localhost";  ///< clients: name or IPv4 address
  std::string listen;                     ///< interface name or IPv4 address; empty = as the profile says
  std::string profile = "loopback";  ///< "loopback", "wifi" or the path of a file like deploy/dds/wifi.xml
  std::string tag = "cairn";         ///< of the site; peers with another tag are not heard
  std::chrono::milliseconds lease{30000};  ///< silence after which a peer is taken as gone
  int loss_per_mille = 0;                  ///< outgoing packets dropped on purpose; for tests
  Logger log = null_logger();              ///< is told of samples that are dropped as unfit
};

/// UDP port at which the server of a domain listens for clients.
[[nodiscard]] constexpr uint16_t server_port(uint32_t domain) {
  return static_cast<uint16_t>(7400 + 250 * domain + 10);
}

/// Bytes of messages, without protocol overhead and repetitions.
struct Traffic {
  uint64_t bytes_sent = 0;
  uint64_t bytes_received = 0;
};

namespace internal {
class Context;
}

/// This process's place in a DDS domain. Several live side by side in one process, of one domain or of
/// several. Readers and writers made from it keep it alive. Thread-safe.
class Participant {
 public:
  /// Joins the domain with a configuration of its own making; the environment (CYCLONEDDS_URI) has no say.
  /// The other end need not be there. Errors: kConfiguration (domain, profile, interface), kNoServer (host
  /// name unknown), kRefused (role server and the domain has one on this host).
  [[nodiscard]] static Result<Participant> create(const ParticipantOptions& options);

  [[nodiscard]] Traffic traffic() const;
  [[nodiscard]] const std::shared_ptr<internal::Context>& context() const { return context_; }

 private:
  explicit Participant(std::shared_ptr<internal::Context> context) : context_(std::move(context)) {}
  std::shared_ptr<internal::Context> context_;
};

}  // namespace cairn::wire
