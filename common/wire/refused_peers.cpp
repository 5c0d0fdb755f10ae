// SPDX-License-Identifier: Apache-2.0
#include "common/wire/refused_peers.h"

#include <array>
#include <utility>

#include "common/map/ids.h"

namespace cairn::wire {
namespace {

constexpr std::string_view kSubject = "; subject: ";

/// The value of a part of "/O=cairn/OU=client/CN=phone-1(code: 200)"; empty without, or where it is no name.
std::string_view part_of(std::string_view subject, std::string_view key) {
  const size_t at = subject.find(key);
  if (at == std::string_view::npos) return {};
  const std::string_view value = subject.substr(at + key.size());
  const std::string_view name =
      value.substr(0, value.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789-"));
  return is_valid_name(name) ? name : std::string_view();
}

std::string named(std::string_view subject) {
  const std::string_view role = part_of(subject, "/OU=");
  const std::string_view name = part_of(subject, "/CN=");
  if (role.empty() || name.empty()) return "somebody";
  return std::string("somebody as ").append(role).append(" ").append(name);
}

/// The reason in words, from what the middleware says of a certificate: "Begin handshake reply failed:
/// Certificate not valid: error: certificate revoked".
std::string reason_of(std::string_view words) {
  constexpr std::string_view kError = "error: ";
  const size_t at = words.rfind(kError);
  std::string_view reason = at == std::string_view::npos ? words : words.substr(at + kError.size());
  if (reason.starts_with("certificate revoked")) return "its keys were revoked";
  constexpr size_t kMost = 120;
  return "its certificate is not accepted: " + std::string(reason.substr(0, kMost));
}

}  // namespace

std::optional<RefusedPeer> refused_peer_in(std::string_view line) {
  if (const size_t at = line.find(kSubject); at != std::string_view::npos)
    return RefusedPeer{named(line.substr(at)), reason_of(line.substr(0, at))};
  struct Words {
    std::string_view first;
    std::string_view second;
    std::string_view why;
  };
  constexpr std::array kWords{
      Words{"Could not get remote participant", "permissions from plugin",
            "its permissions are not accepted: not signed by the authority of this site, expired or damaged"},
      Words{"does not allow remote participant", "", "its permissions do not let it take part"},
      Words{"Permissions validity period", "expired", "its permissions have expired"},
      Words{"handshake", "failed", "it does not prove who it is"},
  };
  for (const Words& words : kWords) {
    if (line.find(words.first) != std::string_view::npos && line.find(words.second) != std::string_view::npos)
      return RefusedPeer{"somebody", std::string(words.why)};
  }
  return std::nullopt;
}

bool RefusedPeers::note(std::string_view line) {
  auto peer = refused_peer_in(line);
  if (!peer) return false;
  const std::lock_guard lock(mutex_);
  if (peers_.size() < kMost) peers_.insert(*std::move(peer));
  return true;
}

std::vector<RefusedPeer> RefusedPeers::take() {
  const std::lock_guard lock(mutex_);
  std::vector<RefusedPeer> taken(peers_.begin(), peers_.end());
  peers_.clear();
  return taken;
}

}  // namespace cairn::wire
