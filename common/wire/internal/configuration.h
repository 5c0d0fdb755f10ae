// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "common/wire/participant.h"
#include "common/wire/security.h"

namespace cairn::wire::internal {

/// [bytes] No sample is larger, whatever the profile: what a peer may make the middleware assemble, and what
/// a writer takes. The largest that is legal is a seed with two raw images of the largest size, 33.8 MB
/// (convert_test.cpp); a server on a network takes those too, from the trackers of its own host.
constexpr size_t kMaxSampleBytes = 36'000'000;

/// Whether the samples of a participant of that role may wait until their writer is flushed, so that small
/// ones share datagrams. It is so for a server, which writes the many blocks of maps.
[[nodiscard]] constexpr bool writes_in_batches(Role role) {
  return role == Role::kServer;
}

/// Text of a built-in profile (deploy/dds/<name>.xml at build time); empty for any other name.
[[nodiscard]] std::string_view built_in_profile(std::string_view name);

/// Text of a profile, built in or a file.
[[nodiscard]] Result<std::string> read_profile(const std::string& profile);

/// The name or address of the first interface that a profile's text asks for; nothing: it leaves the choice.
[[nodiscard]] std::optional<std::string> interface_of_profile(std::string_view text);

/// The configuration of the middleware as XML: the profile with the interface of the path, where it does not
/// name one itself or `listen` does, then what makes the star. Reads the profile's file; otherwise pure.
/// `place`: of a kWearerCamera, below kMaxWearerCameras. `security`: null for an open site. Errors:
/// kConfiguration (domain, profile).
[[nodiscard]] Result<std::string> make_configuration(const ParticipantOptions& options,
                                                     const NetworkPath& path, uint16_t place = 0,
                                                     const Security* security = nullptr);

}  // namespace cairn::wire::internal
