// SPDX-License-Identifier: Apache-2.0
#include "common/wire/network_path.h"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "common/wire/internal/configuration.h"

namespace cairn::wire {
namespace {

constexpr const char* kElsewhere =
    "192.0.2.1";  ///< in no network (RFC 5737): it is reached by the default route

using FoundAddresses = std::unique_ptr<addrinfo, decltype(&freeaddrinfo)>;

struct Interface {
  std::string name;
  std::string address;  ///< IPv4; an interface of several is several of these; empty: has none
  bool is_loopback = false;
  bool is_up = false;
  bool is_running = false;  ///< has a carrier
};

/// Several names or addresses where one is expected.
bool is_list(const std::string& text) {
  return text.find_first_of(",; ") != std::string::npos;
}

bool is_ipv4_address(const std::string& text) {
  in_addr address{};
  return inet_pton(AF_INET, text.c_str(), &address) == 1;
}

std::string text_of(const sockaddr_in& address) {
  char text[INET_ADDRSTRLEN] = "";
  inet_ntop(AF_INET, &address.sin_addr, text, sizeof(text));
  return text;
}

sockaddr_in ipv4_of(const sockaddr* address) {
  sockaddr_in ipv4{};
  std::memcpy(&ipv4, address, sizeof(ipv4));
  return ipv4;
}

/// The interfaces of this machine in the kernel's order, an entry for each of their addresses. The address of
/// an entry is empty where it is no IPv4 address.
std::vector<Interface> list_interfaces() {
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) != 0) return {};
  const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> owner(list, &freeifaddrs);
  std::vector<Interface> interfaces;
  for (const ifaddrs* it = list; it != nullptr; it = it->ifa_next) {
    const bool has_ipv4 = it->ifa_addr != nullptr && it->ifa_addr->sa_family == AF_INET;
    interfaces.push_back({it->ifa_name, has_ipv4 ? text_of(ipv4_of(it->ifa_addr)) : "",
                          (it->ifa_flags & IFF_LOOPBACK) != 0, (it->ifa_flags & IFF_UP) != 0,
                          (it->ifa_flags & IFF_RUNNING) != 0});
  }
  return interfaces;
}

/// "lo (127.0.0.1), wlan0 (10.77.0.2)"
std::string list_of(const std::vector<Interface>& interfaces) {
  std::string text;
  for (const Interface& interface : interfaces) {
    if (interface.address.empty()) continue;
    text += (text.empty() ? "" : ", ") + interface.name + " (" + interface.address + ")";
  }
  return text.empty() ? "none" : text;
}

/// Why an interface asked for cannot be used, or the one that it is. `asked`: name or IPv4 address.
Result<NetworkPath> find_interface(const std::string& asked) {
  if (is_list(asked)) {
    return fail(
        ErrorCode::kUsage,
        "'" + asked + "': several network interfaces, and one is used; pass its name or IPv4 address");
  }
  const std::vector<Interface> all = list_interfaces();
  const auto is_meant = [&](const Interface& i) { return i.name == asked || i.address == asked; };
  const auto usable = std::find_if(all.begin(), all.end(), [&](const Interface& i) {
    return is_meant(i) && i.is_up && !i.address.empty();
  });
  if (usable != all.end()) return NetworkPath{"", usable->name, usable->address};
  const auto known = std::find_if(all.begin(), all.end(), is_meant);
  const std::string why = known == all.end()
                              ? "no such network interface, and no IPv4 address of this machine"
                          : !known->is_up ? "this network interface is down"
                                          : "this network interface has no IPv4 address";
  return fail(ErrorCode::kConfiguration, "'" + asked + "': " + why + "; there are " + list_of(all));
}

/// Our end of the kernel's route to an address. No packet is sent.
Result<NetworkPath> ask_route(const std::string& address) {
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return fail(ErrorCode::kIo, std::string("UDP socket: ") + std::strerror(errno));
  sockaddr_in remote{};
  remote.sin_family = AF_INET;
  remote.sin_port = htons(server_port(0));
  inet_pton(AF_INET, address.c_str(), &remote.sin_addr);
  sockaddr_in local{};
  socklen_t length = sizeof(local);
  const bool found = connect(fd, reinterpret_cast<const sockaddr*>(&remote), sizeof(remote)) == 0 &&
                     getsockname(fd, reinterpret_cast<sockaddr*>(&local), &length) == 0;
  const int problem = errno;
  close(fd);
  if (!found) return fail(ErrorCode::kNoServer, std::strerror(problem));
  return find_interface(text_of(local));
}

/// The IPv4 address of a host. Errors: kUsage for what is no name and no IPv4 address, kNoServer for a name
/// that is unknown or has no IPv4 address.
Result<std::string> resolve(const std::string& host) {
  if (host == "localhost") return std::string("127.0.0.1");  // also where /etc/hosts is missing (RFC 6761)
  const auto refuse = [&](ErrorCode code, const std::string& why) {
    return fail(code, "server '" + host + "': " + why);
  };
  if (is_list(host)) return refuse(ErrorCode::kUsage, "several servers are not available yet; pass one host");
  if (std::count(host.begin(), host.end(), ':') > 1)
    return refuse(ErrorCode::kUsage,
                  "an IPv6 address, and the service speaks IPv4 only; pass an IPv4 address");
  if (host.find(':') != std::string::npos)
    return refuse(ErrorCode::kUsage, "the port follows from --domain; pass the host alone");
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  if (const int error = getaddrinfo(host.c_str(), nullptr, &hints, &found); error != 0) {
    hints.ai_family = AF_INET6;
    addrinfo* other = nullptr;
    const bool has_ipv6 = getaddrinfo(host.c_str(), nullptr, &hints, &other) == 0;
    const FoundAddresses owner(other, &freeaddrinfo);
    return refuse(
        ErrorCode::kNoServer,
        has_ipv6 ? "this name has an IPv6 address only, and the service speaks IPv4; pass an IPv4 address"
                 : std::string(gai_strerror(error)) + "; pass its address");
  }
  const FoundAddresses owner(found, &freeaddrinfo);
  return text_of(ipv4_of(found->ai_addr));
}

/// The interface that leads elsewhere by default, else the first but loopback that is up and has an IPv4
/// address, those with a carrier before others. Empty without a network: the choice is left to the middleware
/// then.
NetworkPath find_first_network() {
  if (auto by_default = ask_route(kElsewhere)) return *by_default;
  const std::vector<Interface> all = list_interfaces();
  for (const bool with_carrier : {true, false}) {
    const auto first = std::find_if(all.begin(), all.end(), [&](const Interface& i) {
      return !i.is_loopback && i.is_up && !i.address.empty() && i.is_running == with_carrier;
    });
    if (first != all.end()) return {"", first->name, first->address};
  }
  return {};
}

Result<NetworkPath> find_own_end(const ParticipantOptions& options, const std::string& server) {
  if (!options.listen.empty()) return find_interface(options.listen);
  const Result<std::string> profile = internal::read_profile(options.profile);
  if (!profile) return tl::unexpected(profile.error());
  if (const auto fixed = internal::interface_of_profile(*profile)) {
    // The middleware understands more than a name and an address, and judges it.
    return find_interface(*fixed).value_or(NetworkPath{});
  }
  if (options.role == Role::kServer) return find_first_network();
  auto by_route = ask_route(server);
  if (by_route || by_route.error().code != ErrorCode::kNoServer) return by_route;
  return fail(ErrorCode::kNoServer, "no network of this machine leads to the server '" + options.server_host +
                                        "' (" + server + "): " + by_route.error().message + "; there are " +
                                        list_of(list_interfaces()));
}

}  // namespace

std::string describe(const NetworkPath& path) {
  return path.address.empty() ? "the interface of the profile" : path.interface + " (" + path.address + ")";
}

std::string way_to(const std::string& host, const NetworkPath& path) {
  return (path.server == host ? "by " : "at " + path.server + " by ") + describe(path);
}

bool has_address(const std::string& address) {
  const std::vector<Interface> all = list_interfaces();
  return std::any_of(all.begin(), all.end(), [&](const Interface& i) { return i.address == address; });
}

std::string default_profile(const std::string& server_host) {
  const bool is_here =
      server_host == "localhost" || (is_ipv4_address(server_host) && server_host.starts_with("127."));
  return is_here ? "loopback" : "wifi";
}

Result<NetworkPath> find_path(const ParticipantOptions& options) {
  std::string server;
  if (options.role != Role::kServer) {
    Result<std::string> address = resolve(options.server_host);
    if (!address) return tl::unexpected(address.error());
    server = *std::move(address);
  }
  return find_own_end(options, server).map([&](NetworkPath path) {
    path.server = server;
    return path;
  });
}

}  // namespace cairn::wire
