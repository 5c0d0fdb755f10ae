// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "common/base/log.h"
#include "common/base/result.h"
#include "common/base/time.h"

namespace cairn::wire {

/// The network is a star: the server stands at a known port and has no peers; clients have the server as
/// their only peer. A rig stands at a known port of its own, is a client of the server, and has clients too:
/// those who command it. The cameras of one wearer on one host are peers of each other, on the loopback
/// interface, and of nobody else.
enum class Role : uint8_t { kServer, kClient, kRig, kRigClient, kWearerCamera };

constexpr uint32_t kMaxDomain = 230;  ///< ports are 7400 + 250 * domain + ...; 16 bits end there

struct ParticipantOptions {
  uint32_t domain = 0;
  Role role = Role::kClient;
  std::string server_host = "localhost";  ///< name or IPv4 address; of a kRigClient: the rig's
  /// Interface name or IPv4 address of this machine; empty: as the profile says, and where that leaves the
  /// choice, find_path() (network_path.h).
  std::string listen;
  std::string profile = "loopback";  ///< "loopback", "wifi" or the path of a file like deploy/dds/wifi.xml
  std::string tag = "cairn";         ///< of the site; peers with another tag are not heard
  /// Folder with the keys of a secured site (security.h); empty: an open one, which hears everybody.
  std::string security;
  std::chrono::milliseconds lease{30000};  ///< silence after which a peer is taken as gone
  int loss_per_mille = 0;                  ///< outgoing packets dropped on purpose; for tests
  Logger log = null_logger();              ///< is told of samples that are dropped as unfit
};

/// UDP port at which the server of a domain listens for clients.
[[nodiscard]] constexpr uint16_t server_port(uint32_t domain) {
  return static_cast<uint16_t>(7400 + 250 * domain + 10);
}

/// UDP port at which the rig of a host listens for those who command it.
constexpr uint16_t kRigIndex = 50;  ///< above those that ROS 2's programs take
[[nodiscard]] constexpr uint16_t rig_port(uint32_t domain) {
  return static_cast<uint16_t>(server_port(domain) + 2 * kRigIndex);
}

/// UDP ports at which the cameras of wearers listen to those of the same wearer; each takes the first free
/// one of its host.
constexpr uint16_t kFirstWearerIndex = 60;
constexpr uint16_t kMaxWearerCameras = 8;  ///< on a host, in a domain
[[nodiscard]] constexpr uint16_t wearer_port(uint32_t domain, uint16_t place) {
  return static_cast<uint16_t>(server_port(domain) + 2 * (kFirstWearerIndex + place));
}

/// Between which addresses a participant speaks; as they are in use, or would be.
struct NetworkPath {
  std::string server;  ///< IPv4 address, for a kRigClient the rig's; of a server itself: empty
  std::string
      interface;  ///< our own, and its IPv4 address; empty where the profile names what we do not know
  std::string address;
  bool operator==(const NetworkPath&) const = default;
};

/// Our own end, "wlan0 (10.77.0.2)".
[[nodiscard]] std::string describe(const NetworkPath& path);

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
  /// The other end need not be there. Errors: those of find_path() and read_security(), kConfiguration (keys
  /// of another role), kRefused (role server and its port in this domain is taken; role wearer's camera and
  /// all places are).
  [[nodiscard]] static Result<Participant> create(const ParticipantOptions& options);

  [[nodiscard]] Traffic traffic() const;
  /// When our keys expire, and nobody hears us any more; nothing on an open site.
  [[nodiscard]] std::optional<Timestamp> good_until() const;
  /// The network path at the time of joining: addresses that change later are not followed.
  [[nodiscard]] const NetworkPath& path() const;
  [[nodiscard]] const std::shared_ptr<internal::Context>& context() const { return context_; }

 private:
  explicit Participant(std::shared_ptr<internal::Context> context) : context_(std::move(context)) {}
  std::shared_ptr<internal::Context> context_;
};

}  // namespace cairn::wire
