// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "common/wire/participant.h"

namespace cairn::wire::internal {

/// Text of a built-in profile (deploy/dds/<name>.xml at build time); empty for any other name.
[[nodiscard]] std::string_view built_in_profile(std::string_view name);

/// The configuration of the middleware as XML: the profile with the interface asked for, then what makes the
/// star. Reads the profile's file and resolves the server's name; otherwise pure. Errors: those of
/// Participant::create.
[[nodiscard]] Result<std::string> make_configuration(const ParticipantOptions& options);

}  // namespace cairn::wire::internal
