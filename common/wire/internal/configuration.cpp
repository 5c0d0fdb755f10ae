// SPDX-License-Identifier: Apache-2.0
#include "common/wire/internal/configuration.h"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <sstream>

#include "common/base/plain_text.h"

namespace cairn::wire::internal {
namespace {

std::string xml_escaped(std::string_view text) {
  std::string escaped;
  for (const char c : text) {
    switch (c) {
      case '&':
        escaped += "&amp;";
        break;
      case '<':
        escaped += "&lt;";
        break;
      case '>':
        escaped += "&gt;";
        break;
      case '"':
        escaped += "&quot;";
        break;
      default:
        escaped += c;
    }
  }
  return escaped;
}

bool is_ipv4_address(const std::string& text) {
  in_addr address{};
  return inet_pton(AF_INET, text.c_str(), &address) == 1;
}

/// The middleware resolves names too, but says nothing when it cannot.
Result<std::string> resolve(const std::string& host) {
  if (host == "localhost") return std::string("127.0.0.1");  // also where /etc/hosts is missing (RFC 6761)
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  if (const int error = getaddrinfo(host.c_str(), nullptr, &hints, &found); error != 0) {
    return fail(ErrorCode::kNoServer, "server '" + host + "': " + gai_strerror(error) + "; pass its address");
  }
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owner(found, &freeaddrinfo);
  char text[INET_ADDRSTRLEN] = "";
  sockaddr_in address{};
  std::copy_n(reinterpret_cast<const char*>(found->ai_addr), sizeof(address),
              reinterpret_cast<char*>(&address));
  inet_ntop(AF_INET, &address.sin_addr, text, sizeof(text));
  return text;
}

Result<std::string> read_profile(const std::string& profile) {
  if (const std::string_view text = built_in_profile(profile); !text.empty()) return std::string(text);
  constexpr std::uintmax_t kMostBytes = 1 << 20;
  std::error_code error;
  std::string text;
  if (std::filesystem::is_regular_file(profile, error) &&
      std::filesystem::file_size(profile, error) <= kMostBytes) {
    std::ifstream file(profile);
    text.assign(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
    auto plain = plain_text(std::move(text), profile);
    if (!plain) return fail(ErrorCode::kConfiguration, plain.error().message);
    text = std::move(*plain);
  }
  if (text.find("<CycloneDDS") == std::string::npos) {
    return fail(ErrorCode::kConfiguration,
                "profile '" + profile + "': neither loopback, wifi nor a file of Cyclone DDS settings");
  }
  return text;
}

Result<std::string> interface_element(const std::string& listen) {
  const bool address = is_ipv4_address(listen);
  if (!address && if_nametoindex(listen.c_str()) == 0) {
    return fail(ErrorCode::kConfiguration,
                "'" + listen + "': no such network interface and not an IPv4 address; see 'ip address'");
  }
  return std::string("<Interfaces><NetworkInterface ") + (address ? "address" : "name") + "=\"" +
         xml_escaped(listen) + "\" multicast=\"false\" /></Interfaces>";
}

/// A server on a network also serves the trackers of its own host, whose profile knows the loopback interface
/// only; the middleware reaches a loopback address only from a loopback interface (measured).
constexpr std::string_view kLoopback =
    "<Interfaces><NetworkInterface address=\"127.0.0.1\" multicast=\"false\" /></Interfaces>";

/// Whether there is any interface beside loopback; without one the middleware chooses loopback itself and
/// refuses it twice.
bool has_network() {
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) != 0) return false;
  const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> owner(list, &freeifaddrs);
  for (const ifaddrs* it = list; it != nullptr; it = it->ifa_next) {
    const bool usable = (it->ifa_flags & IFF_UP) != 0 && (it->ifa_flags & IFF_LOOPBACK) == 0;
    if (usable && it->ifa_addr != nullptr && it->ifa_addr->sa_family == AF_INET) return true;
  }
  return false;
}

bool names_loopback(std::string_view xml) {
  return xml.find("\"127.") != std::string_view::npos || xml.find("\"lo\"") != std::string_view::npos;
}

/// Takes the profile's own choice of interfaces out: a second <Interfaces> would add to it.
void remove_interfaces(std::string* profile) {
  constexpr std::string_view kEnd = "</Interfaces>";
  const size_t begin = profile->find("<Interfaces>");
  const size_t end = profile->find(kEnd);
  if (begin == std::string::npos || end == std::string::npos || end < begin) return;
  profile->erase(begin, end + kEnd.size() - begin);
}

}  // namespace

Result<std::string> make_configuration(const ParticipantOptions& options) {
  if (options.domain > kMaxDomain) {
    return fail(ErrorCode::kConfiguration, "domain " + std::to_string(options.domain) + ": 0 to " +
                                               std::to_string(kMaxDomain) + " are possible");
  }
  Result<std::string> profile = read_profile(options.profile);
  if (!profile) return profile;
  std::string interfaces;
  if (!options.listen.empty()) {
    Result<std::string> element = interface_element(options.listen);
    if (!element) return element;
    interfaces = *std::move(element);
    remove_interfaces(&*profile);
  }
  if (options.role == Role::kServer && !names_loopback(*profile) && !names_loopback(interfaces) &&
      has_network()) {
    interfaces += kLoopback;
  }

  std::ostringstream xml;
  xml << *profile << ",<CycloneDDS><Domain Id=\"any\"><General><AllowMulticast>false</AllowMulticast>"
      << interfaces << "</General><Discovery><ExternalDomainId>" << options.domain
      << "</ExternalDomainId><Tag>" << xml_escaped(options.tag)
      << "</Tag><SPDPInterval>1s</SPDPInterval><LeaseDuration>" << options.lease.count()
      << "ms</LeaseDuration>";
  if (options.role == Role::kServer) {
    xml << "<ParticipantIndex>0</ParticipantIndex>";
  } else {
    Result<std::string> address = resolve(options.server_host);
    if (!address) return address;
    xml << "<ParticipantIndex>none</ParticipantIndex><Peers><Peer address=\"" << *address << ':'
        << server_port(options.domain) << "\" /></Peers>";
  }
  xml << "</Discovery>";
  if (options.loss_per_mille > 0) {
    xml << "<Internal><Test><XmitLossiness>" << options.loss_per_mille
        << "</XmitLossiness></Test></Internal>";
  }
  xml << "</Domain></CycloneDDS>";
  return xml.str();
}

}  // namespace cairn::wire::internal
