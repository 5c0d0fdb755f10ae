// SPDX-License-Identifier: Apache-2.0
#include "common/wire/internal/configuration.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <vector>

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

/// A server or rig on a network also serves the trackers of its own host, whose profile knows the loopback
/// interface only; the middleware reaches a loopback address only from a loopback interface (measured).
constexpr const char* kLoopback = "127.0.0.1";

std::string interface_element(const std::string& address) {
  return "<Interfaces><NetworkInterface address=\"" + xml_escaped(address) +
         "\" multicast=\"false\" /></Interfaces>";
}

/// The value of an attribute within an element's text; empty without. `name`: as ` name="`.
std::string_view attribute(std::string_view element, std::string_view name) {
  const size_t at = element.find(name);
  if (at == std::string_view::npos) return {};
  const std::string_view value = element.substr(at + name.size());
  return value.substr(0, value.find('"'));
}

bool names_loopback(std::string_view xml) {
  return xml.find("\"127.") != std::string_view::npos || xml.find("\"lo\"") != std::string_view::npos;
}

/// The participant index in DDS from which its port follows; "none" where the middleware may choose.
std::string index_of(Role role, uint16_t place) {
  switch (role) {
    case Role::kServer:
      return "0";
    case Role::kRig:
      return std::to_string(kRigIndex);
    case Role::kWearerCamera:
      return std::to_string(kFirstWearerIndex + place);
    case Role::kClient:
    case Role::kRigClient:
      break;
  }
  return "none";
}

/// The ports of the participants that this one speaks to first.
std::vector<uint16_t> peer_ports(const ParticipantOptions& options) {
  std::vector<uint16_t> ports;
  switch (options.role) {
    case Role::kServer:
      break;
    case Role::kClient:
    case Role::kRig:
      ports.push_back(server_port(options.domain));
      break;
    case Role::kRigClient:
      ports.push_back(rig_port(options.domain));
      break;
    case Role::kWearerCamera:
      for (uint16_t place = 0; place < kMaxWearerCameras; ++place)
        ports.push_back(wearer_port(options.domain, place));
      break;
  }
  return ports;
}

/// Takes the profile's own choice of interfaces out: a second <Interfaces> would add to it.
void remove_interfaces(std::string* profile) {
  constexpr std::string_view kEnd = "</Interfaces>";
  const size_t begin = profile->find("<Interfaces>");
  const size_t end = profile->find(kEnd);
  if (begin == std::string::npos || end == std::string::npos || end < begin) return;
  profile->erase(begin, end + kEnd.size() - begin);
}

/// Our part of DDS Security: which plugins, and whose keys. The names of the plugins are found by the
/// middleware itself, in Debian beside its library.
std::string security_element(const Security& security) {
  const auto plugin = [](const std::string& name, const std::string& functions) {
    return "<Library path=\"dds_security_" + name + "\" initFunction=\"init_" + functions +
           "\" finalizeFunction=\"finalize_" + functions + "\" />";
  };
  const auto file = [&](const char* element, const char* name) {
    return std::string("<") + element + ">file:" + xml_escaped((security.folder / name).string()) + "</" +
           element + ">";
  };
  return "<Security><Authentication>" + plugin("auth", "authentication") +
         file("IdentityCA", "identity_ca.cert.pem") + file("IdentityCertificate", "cert.pem") +
         file("PrivateKey", "key.pem") + file("CRL", "crl.pem") + "</Authentication><Cryptographic>" +
         plugin("crypto", "crypto") + "</Cryptographic><AccessControl>" + plugin("ac", "access_control") +
         file("PermissionsCA", "permissions_ca.cert.pem") + file("Governance", "governance.p7s") +
         file("Permissions", "permissions.p7s") + "</AccessControl></Security>";
}

}  // namespace

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

std::optional<std::string> interface_of_profile(std::string_view text) {
  constexpr std::string_view kElement = "<NetworkInterface";
  const size_t begin = text.find(kElement);
  if (begin == std::string_view::npos) return std::nullopt;
  const size_t end = text.find('>', begin);
  if (end == std::string_view::npos) return std::nullopt;  // the middleware says what is wrong with it
  const std::string_view element = text.substr(begin, end - begin);
  for (const std::string_view name : {" address=\"", " name=\""}) {
    if (const std::string_view value = attribute(element, name); !value.empty()) return std::string(value);
  }
  // An older element, <NetworkInterfaceAddress>, has it as its text.
  if (!element.starts_with("<NetworkInterfaceAddress")) return std::nullopt;
  const size_t value = end + 1;
  return std::string(text.substr(value, text.find('<', value) - value));
}

Result<std::string> make_configuration(const ParticipantOptions& options, const NetworkPath& path,
                                       uint16_t place, const Security* security) {
  if (options.domain > kMaxDomain) {
    return fail(ErrorCode::kConfiguration, "domain " + std::to_string(options.domain) + ": 0 to " +
                                               std::to_string(kMaxDomain) + " are possible");
  }
  Result<std::string> profile = read_profile(options.profile);
  if (!profile) return profile;
  std::string interfaces;
  const bool is_fixed = options.listen.empty() && interface_of_profile(*profile);
  if (!is_fixed && !path.address.empty()) {
    interfaces = interface_element(path.address);
    remove_interfaces(&*profile);
  }
  const bool has_network = is_fixed || !path.address.empty();
  const bool has_clients = options.role == Role::kServer || options.role == Role::kRig;
  if (has_clients && has_network && !names_loopback(*profile) && !names_loopback(interfaces)) {
    interfaces += interface_element(kLoopback);
  }

  std::ostringstream xml;
  xml << *profile << ",<CycloneDDS><Domain Id=\"any\"><General><AllowMulticast>false</AllowMulticast>"
      << interfaces << "</General><Discovery><ExternalDomainId>" << options.domain
      << "</ExternalDomainId><Tag>" << (security != nullptr ? security->tag + "." : "")
      << xml_escaped(options.tag) << "</Tag><SPDPInterval>1s</SPDPInterval><LeaseDuration>"
      << options.lease.count() << "ms</LeaseDuration>";
  xml << "<ParticipantIndex>" << index_of(options.role, place) << "</ParticipantIndex>";
  if (const auto ports = peer_ports(options); !ports.empty()) {
    xml << "<Peers>";
    for (const uint16_t port : ports) xml << "<Peer address=\"" << path.server << ':' << port << "\" />";
    xml << "</Peers>";
  }
  xml << "</Discovery>";
  // By default a peer could have a sample of 2 GB put together here before anybody looks at it.
  xml << "<Internal><MaxSampleSize>" << kMaxSampleBytes << "B</MaxSampleSize>";
  // A thread for each socket would end only by a packet to our own address: never, once that is gone.
  xml << "<MultipleReceiveThreads>false</MultipleReceiveThreads>";
  // Each writer would hold up its thread for a second where a peer does not acknowledge, one after another.
  xml << "<WriterLingerDuration>0s</WriterLingerDuration>";
  if (writes_in_batches(options.role)) xml << "<WriteBatch>true</WriteBatch>";
  if (options.loss_per_mille > 0)
    xml << "<Test><XmitLossiness>" << options.loss_per_mille << "</XmitLossiness></Test>";
  xml << "</Internal>";
  if (security != nullptr) xml << security_element(*security);
  xml << "</Domain></CycloneDDS>";
  return xml.str();
}

}  // namespace cairn::wire::internal
