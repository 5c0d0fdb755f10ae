// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "common/base/result.h"
#include "common/wire/participant.h"

namespace cairn::wire {

/// Whether the machine has this IPv4 address at this moment.
[[nodiscard]] bool has_address(const std::string& address);

/// A client's way to its server in words, "at 10.77.0.1 by wlan0 (10.77.0.2)". The server's address is left
/// out where `host`, as it was named, is that address.
[[nodiscard]] std::string way_to(const std::string& host, const NetworkPath& path);

/// The profile for a server's name when none is asked for: loopback for this host, wifi for any other.
[[nodiscard]] std::string default_profile(const std::string& server_host);

/// The path that a participant made now would take: the interface asked for (`listen`), else the one that
/// the profile names, else, where the profile leaves the choice, that of the kernel's route to the server;
/// for a server that of the default route, else the first network there is. Nothing is sent to the server;
/// the name may be asked of a name service, which may take seconds. Errors: kConfiguration (domain, profile,
/// interface), kUsage (what is no name and no IPv4 address), kNoServer (name unknown, no route).
[[nodiscard]] Result<NetworkPath> find_path(const ParticipantOptions& options);

}  // namespace cairn::wire
